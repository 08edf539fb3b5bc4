"""Select the mechanisms that explain a misfit."""
