"""Cross-validate the selection on the training blocks; compute the errors on the held-out blocks."""
