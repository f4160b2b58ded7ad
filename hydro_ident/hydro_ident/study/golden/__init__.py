"""Golden bags: recordings that are replayed through controller and diagnosis and compared."""
