"""Commands of pamjax, one module for each."""
