"""The fault campaign: machine, bridge and controller with faults, judged at the valves."""
