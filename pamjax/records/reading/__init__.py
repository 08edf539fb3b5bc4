"""Read recording.csv and muscle.toml."""
