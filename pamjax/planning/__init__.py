"""Plan the next runs."""
