"""Empirical models, for comparison."""
