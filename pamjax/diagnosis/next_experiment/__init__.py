"""Propose protocols that distinguish mechanisms which the recording does not."""
