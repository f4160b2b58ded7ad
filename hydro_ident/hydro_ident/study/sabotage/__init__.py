"""Deliberate faults of the diagnosis, each with the test that has to notice it."""
