"""Cylinders and valves: geometry, forces, volumes and flows."""
