"""Design a muscle for a spec by gradient-based optimisation."""
