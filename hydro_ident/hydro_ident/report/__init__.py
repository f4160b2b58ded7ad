"""Reports: one self-contained HTML file, no network, no scripts."""
