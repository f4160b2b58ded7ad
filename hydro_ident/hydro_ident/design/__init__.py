"""Experiment design: limits, information, optimised motion and predicted errors."""
