"""Force channels: regressor rows, base parameters, barrels, rods and bounds."""
