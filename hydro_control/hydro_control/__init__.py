"""Model-based valve control of a hydraulic manipulator."""
