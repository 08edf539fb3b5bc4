"""Detect and locate a misfit."""
