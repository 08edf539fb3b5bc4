"""Compiled programs: caches on disk, and threads that compile or run them."""
