"""Check a recording for unit errors and stuck sensors."""
