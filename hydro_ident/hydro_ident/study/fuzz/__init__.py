"""Broken and hostile files for every loader: a result or a clear error, never anything else."""
