"""Topics, bus and bag contract."""
