"""Free parameters of a fit, their priors, and the arrays of a recording."""
