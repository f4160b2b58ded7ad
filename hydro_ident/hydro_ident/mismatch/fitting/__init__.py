"""Base and effects fitted to rows: weights, steps within bounds, noise."""
