"""Noise of a recording under diagnosis."""
