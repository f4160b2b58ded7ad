"""The safety gate: the only way from a command to the valves."""
