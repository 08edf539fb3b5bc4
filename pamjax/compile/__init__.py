"""Compiled programs: caches on disk, and threads that run them."""
