"""Measurements of speed against what a user would take instead, a floor or a limit."""
