"""Competitors of a diagnosis in common practice: empirical formulas, a Gaussian process and stepwise BIC."""
