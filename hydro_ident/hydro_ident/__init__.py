"""Identification of a hydraulic manipulator from recorded bags."""
