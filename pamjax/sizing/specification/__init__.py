"""Specification of a sizing: its entries, the catalogue of materials, and the parts that are sold."""
