"""The CAN bus: its interfaces, how it is, whose it is, and the way of frames onto it."""
