"""Figures, reports and their style."""
