"""The shared model of a hydraulic manipulator."""
