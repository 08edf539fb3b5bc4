"""Locate and name the physics that a model leaves out, and test the names on held-out blocks."""
