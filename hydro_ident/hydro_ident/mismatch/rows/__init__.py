"""Recordings as rows of residual channels, and a model's prediction of them."""
