"""Choice of mechanisms by evidence, with form errors."""
