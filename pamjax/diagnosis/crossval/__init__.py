"""Test the selected mechanisms on held-out blocks."""
