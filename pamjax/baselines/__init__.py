"""Standard methods for comparison: empirical formulas, a Gaussian process and stepwise BIC."""
