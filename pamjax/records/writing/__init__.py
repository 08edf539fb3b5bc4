"""Write case folders."""
