"""Refits of the baseline with candidate mechanisms."""
