"""Detect and locate a mismatch."""
