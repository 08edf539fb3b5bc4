"""Which numbers fit, and how sure they are."""
