"""Measurements of speed against what a user would take instead, side by side."""
