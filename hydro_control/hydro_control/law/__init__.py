"""The control law, compiled and as one reads it."""
