"""What was measured: recordings, case folders, and the blocks they fall into."""
