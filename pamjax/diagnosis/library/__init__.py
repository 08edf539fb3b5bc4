"""A recording with the whole library of mechanisms, and the candidates to test."""
