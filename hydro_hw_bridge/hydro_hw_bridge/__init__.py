"""CAN bridge and simulated machine of a hydraulic manipulator."""
