"""Writing of case folders."""
