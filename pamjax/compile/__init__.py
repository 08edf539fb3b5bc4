"""Compiled programs: their caches on disk, and threads that run them."""
