"""Bags to aligned columns and back."""
