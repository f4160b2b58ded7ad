"""Locate: where in state space a channel is worse than its own noise."""
