"""The node around the core, and the commands that speak to it."""
