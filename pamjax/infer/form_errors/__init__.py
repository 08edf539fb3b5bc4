"""Form errors of mechanisms: differences between a real effect and its textbook equation."""
