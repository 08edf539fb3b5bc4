"""Propose the protocol that separates what a recording cannot."""
