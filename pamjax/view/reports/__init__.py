"""Reports: one offline HTML file each."""
