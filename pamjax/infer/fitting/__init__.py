"""Least-squares fits, cross-validation and identifiability."""
