"""Templates: effects outside the library, which compete with its mechanisms."""
