"""How it looks: theme, plots, reports."""
