"""What a law of the effects catalogue may look at: the signals of one cylinder, by index.

A law receives one row of `SIGNAL_COUNT` numbers, in a roll-out from the state, in the
identification from a recording. Pressures are gauge. In a roll-out, signals that are an outcome of
the step or are not simulated are NaN, so that a law that needs them fails loudly:
`PISTON_ACCELERATION`, `VALVE_RATE`, `OIL_TEMPERATURE` where it was not measured, and `SUPPLY_FLOW`
and `RETURN_FLOW` for laws of a single cylinder (the sums over all valves are known to laws of the
whole robot only), and `OTHER_ACCELERATION`. On a joint without cylinder, pressures, areas, edges
and flows are NaN, and the piston's force is the drive's torque.
`hydro_model.effects.rows.signal_rows` fills them from a recording.

Only append: compiled laws in a user's numba cache hold these numbers.
"""

from __future__ import annotations

TIME = 0  # s
PISTON_POSITION = 1  # m
PISTON_VELOCITY = 2  # m/s
PISTON_ACCELERATION = 3  # m/s^2
PRESSURE_A = 4  # Pa
PRESSURE_B = 5  # Pa
SUPPLY_PRESSURE = 6  # Pa, at the valve
TANK_PRESSURE = 7  # Pa, at the valve
VALVE_SIGNAL = 8  # normalised, as the effects before this one left it
VALVE_RATE = 9  # 1/s
PISTON_FORCE = 10  # N, p_a A1 - p_b A2; the torque of a drive that is no cylinder
LEVER = 11  # m/rad
JOINT_POSITION = 12  # rad or m
JOINT_VELOCITY = 13  # rad/s or m/s
SUPPLY_FLOW = 14  # m^3/s, drawn from the supply by all valves
RETURN_FLOW = 15  # m^3/s, returned to tank by all valves
OIL_TEMPERATURE = 16  # deg C
ATMOSPHERIC_PRESSURE = 17  # Pa absolute
STATE_0 = 18  # the effect's own internal states
STATE_1 = 19
STATE_2 = 20
STATE_3 = 21
OTHER_POSITION = 22  # rad or m, of the next joint outwards, or of the one before the last
OTHER_VELOCITY = 23  # rad/s or m/s
OTHER_ACCELERATION = 24  # rad/s^2 or m/s^2
TRAVEL_LOW = 25  # m, end of the piston's travel: 0 (a joint's lower limit where no cylinder is)
TRAVEL_HIGH = 26  # m, the stroke (the joint's upper limit)
AREA_A = 27  # m^2
AREA_B = 28  # m^2
EDGE_PA = 29  # m^3/(s sqrt(Pa)), coefficients of the valve's edges
EDGE_AT = 30
EDGE_PB = 31
EDGE_BT = 32
VALVE_FLOW_A = 33  # m^3/s, into chamber A by the valve, as flow laws before one have left it
VALVE_FLOW_B = 34  # m^3/s, into chamber B
TIP_HEIGHT = 35  # m, of the tip over the base's origin, against gravity
TIP_SLOPE = 36  # m/rad (1 where it slides), how much it rises as this joint moves
TIP_RATE = 37  # m/s, of the tip's height

SIGNAL_COUNT = 38
MAX_STATES = 4

#: Names of the signals in index order, for tables and reports.
SIGNAL_NAMES = (
    "time",
    "piston_position",
    "piston_velocity",
    "piston_acceleration",
    "pressure_a",
    "pressure_b",
    "supply_pressure",
    "tank_pressure",
    "valve_signal",
    "valve_rate",
    "piston_force",
    "lever",
    "joint_position",
    "joint_velocity",
    "supply_flow",
    "return_flow",
    "oil_temperature",
    "atmospheric_pressure",
    "state_0",
    "state_1",
    "state_2",
    "state_3",
    "other_position",
    "other_velocity",
    "other_acceleration",
    "travel_low",
    "travel_high",
    "area_a",
    "area_b",
    "edge_pa",
    "edge_at",
    "edge_pb",
    "edge_bt",
    "valve_flow_a",
    "valve_flow_b",
    "tip_height",
    "tip_slope",
    "tip_rate",
)
