"""What of the machine is watched beside the gate: readings, cycles, echoes of valve frames."""
