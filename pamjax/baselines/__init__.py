"""Baselines of common practice to compare a diagnosis with: formulas, a Gaussian process, stepwise BIC."""
