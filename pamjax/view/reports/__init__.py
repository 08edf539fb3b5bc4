"""Reports: offline HTML files."""
