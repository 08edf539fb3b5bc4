"""Recordings, case folders, and the blocks of rows in a recording."""
