"""Faults between machine, bridge and controller, for tests and the fault campaign."""
