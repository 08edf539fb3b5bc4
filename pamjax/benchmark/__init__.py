"""The simulation study behind `pamjax prove`."""
