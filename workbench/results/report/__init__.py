"""Reports on many runs: groups, tables, plots, a page."""
