"""Simulation study of `pamjax prove`: diagnoses of recordings with concealed effects."""
