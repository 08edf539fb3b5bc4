"""Detect and locate misfit, select the mechanisms that explain it, and test them on held-out blocks."""
