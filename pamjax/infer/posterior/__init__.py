"""Posterior distributions: samplers, convergence, model comparison and reports."""
