"""The node around the core: threads, publishers, parameters, diagnostics."""
