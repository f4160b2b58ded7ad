"""Recordings piece by piece: where they come from, cleaned, beside the truth."""
