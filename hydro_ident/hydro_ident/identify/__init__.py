"""Identification from recordings: the pure core of `identify`, its verdict and its files."""
