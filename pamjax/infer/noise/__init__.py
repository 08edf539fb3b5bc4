"""Noise of a recording's channels."""
