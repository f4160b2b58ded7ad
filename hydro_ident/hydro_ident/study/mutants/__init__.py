"""Mutation testing of the safety gate and the watchdogs."""
