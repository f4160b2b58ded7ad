"""Compensation of the effects that a model file lists."""
