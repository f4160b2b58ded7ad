"""Command lines of the package, one module each."""
