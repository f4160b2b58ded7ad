"""Model-based valve control of a hydraulic manipulator.

Arguments are named as in `hydro_model`; besides, `axes` are the joints with what drives them, in
the robot's order.
"""
