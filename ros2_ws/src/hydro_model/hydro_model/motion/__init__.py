"""Paths of the joints or the tip, and whether a robot can follow them."""
