"""Select the mechanisms that explain a mismatch."""
