"""Reports: one self-contained HTML file that fetches nothing, with its plotting library in it."""
