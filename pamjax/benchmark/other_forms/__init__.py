"""Simulated recordings whose effects have other forms than those of the fit, for `pamjax prove --bank`."""
