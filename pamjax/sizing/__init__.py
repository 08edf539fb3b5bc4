"""Size a muscle by gradient."""
