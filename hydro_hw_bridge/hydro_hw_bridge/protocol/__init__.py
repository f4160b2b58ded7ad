"""Frames of the bus to readings and back, by DBC, mapping and calibration; whole cycles."""
