"""Fleets of recordings: their cases, their store, and statistics over specimens."""
