"""Check a recording for unit errors, stuck and clipped sensors."""
