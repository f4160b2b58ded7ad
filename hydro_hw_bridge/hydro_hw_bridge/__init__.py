"""CAN bridge and simulated machine of a hydraulic manipulator.

Arguments are named as in `hydro_model`; besides, everywhere here:

- `data`: the bytes of a frame, or of all frames of a cycle by the frame's name;
- `voltages`: V per valve, in the robot's order; `counter`: the sample counter of a cycle;
- `emergency_stop_ok`, `pump_on`, `enable_switch`: permissive inputs, on while driving is allowed.
"""
