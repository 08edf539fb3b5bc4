"""Noise models of a recording for a diagnosis."""
