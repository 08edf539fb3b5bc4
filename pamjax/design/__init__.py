"""What to build, what to command, what to measure next."""
