"""Before a machine is driven: its bus made from a robot file, its calibration."""
