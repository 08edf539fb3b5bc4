"""Estimation of parameters: fits, posteriors, priors and noise."""
