"""What is missing from a model, and what else one could use."""
