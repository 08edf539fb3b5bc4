"""Refits of a diagnosis with form errors as noise."""
