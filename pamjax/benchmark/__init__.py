"""Simulation study of `pamjax prove`: known effects in simulated recordings, diagnosed blindly."""
