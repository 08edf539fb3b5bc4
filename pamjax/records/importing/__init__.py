"""Import a rig's raw files."""
