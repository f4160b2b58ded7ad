"""Bodies that can exist."""
