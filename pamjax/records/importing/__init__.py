"""Import of a test rig's raw files."""
