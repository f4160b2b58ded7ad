"""Identified parameters, their names and how sure they are."""
