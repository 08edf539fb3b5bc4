"""Everything that models leave out, one mechanism a file."""
