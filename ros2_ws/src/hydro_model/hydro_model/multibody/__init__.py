"""Rigid bodies along a chain of joints: kinematics, dynamics, base parameters."""
