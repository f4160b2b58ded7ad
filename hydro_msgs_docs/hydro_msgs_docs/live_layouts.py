"""What live tools show of a robot's topics: bring-up, tracking, diagnosis.

A view is rows of plots, a plot a list of signals of the contract; `layout_files` writes both
programs' files from the same views. PlotJuggler names an entry of a JointState
`<topic>/<name>/<field>`; Foxglove can only count, `<topic>.<field>[<index>]`, so its files hold
for a robot's order of names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hydro_model.robot import Robot
from hydro_msgs_docs import topics

#: One for each joint, as in the reports: palette of Okabe and Ito, without its yellow.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
#: For what is no joint's, whatever the robot: supply, tank, and one more (the tip has three). To
#: colour-blind eyes, too, they are further from those of joints than these are from one another.
OTHERS = ("#8833EE", "#994433", "#595959")


@dataclass(frozen=True, slots=True)
class Signal:
    """One number of a topic.

    Attributes
    ----------
    topic, field : str
        The field in the message, with dots.
    label : str
    name : str
        Entry of a JointState; empty for other messages.
    index : int
        Its place in the robot's order of names.
    colour : str
        Its joint's; paler where a plot has two of a joint. That of no joint, where it is of none.
    """

    topic: str
    field: str
    label: str
    name: str = ""
    index: int = 0
    colour: str = OTHERS[0]

    @property
    def plotjuggler(self) -> str:
        """Name of its series in PlotJuggler."""
        parts = (self.name, self.field) if self.name else (self.field.replace(".", "/"),)
        return "/".join((self.topic, *parts))

    @property
    def foxglove(self) -> str:
        """Its message path in Foxglove."""
        return f"{self.topic}.{self.field}" + (f"[{self.index}]" if self.name else "")


@dataclass(frozen=True, slots=True)
class Plot:
    """Signals over time in one frame, all in one unit.

    `title` heads the frame.
    """

    title: str
    signals: tuple[Signal, ...]


@dataclass(frozen=True, slots=True)
class View:
    """Rows of plots, from above; empty plots are left out.

    Attributes
    ----------
    name : str
    rows : tuple of tuple of Plot
    diagnostics : bool
        Show `/diagnostics` beside them, where the program can.
    """

    name: str
    rows: tuple[tuple[Plot, ...], ...]
    diagnostics: bool = False

    @property
    def shown(self) -> tuple[tuple[Plot, ...], ...]:
        """The rows that have something to show."""
        rows = (tuple(plot for plot in row if plot.signals) for row in self.rows)
        return tuple(row for row in rows if row)

    @property
    def signals(self) -> tuple[Signal, ...]:
        """All signals, each once."""
        plots = (plot for row in self.shown for plot in row)
        return tuple(dict.fromkeys(signal for plot in plots for signal in plot.signals))


def views(robot: Robot) -> tuple[View, ...]:
    """The views of a robot.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of View
        `bringup`, `tracking`, `diagnosis`.
    """
    return _bringup(robot), _tracking(robot), _diagnosis(robot)


def _joint_of(robot: Robot) -> dict[str, int]:
    """Place of an entry's joint by its name: the joint's, a cylinder's, chamber's or valve's."""
    found = {name: k for k, name in enumerate(robot.joint_names)}
    for cylinder in robot.cylinders:
        k = robot.joint_index(cylinder.joint)
        found |= {cylinder.name: k, f"{cylinder.name}/a": k, f"{cylinder.name}/b": k}
    return found | {v.name: found[v.cylinder] for v in robot.valves}


def _colour(robot: Robot, name: str, place: int, pale: bool) -> str:
    """Of a joint's signal; of the others by their place in their plot."""
    k = _joint_of(robot).get(name)
    if k is None:
        return OTHERS[place % len(OTHERS)]
    colour = COLOURS[k % len(COLOURS)]
    return _paler(colour) if pale else colour


def _paler(colour: str) -> str:
    """Half way to white."""
    parts = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(f"{(part + 255) // 2:02X}" for part in parts)


def _entries(
    robot: Robot,
    at: tuple[str, str],
    names: Sequence[str],
    what: str = "",
    wanted: Sequence[str] | None = None,
) -> tuple[Signal, ...]:
    """Entries of a JointState: `at` is topic and field. What is asked is paler than what is."""
    asked = what in ("wanted", "asked")
    return tuple(
        Signal(
            *at,
            f"{name} {what}".strip(),
            name,
            names.index(name),
            _colour(robot, name, place, asked or name.endswith("/b")),
        )
        for place, name in enumerate(names if wanted is None else wanted)
    )


def _pressures(robot: Robot, wanted: Sequence[str]) -> tuple[Signal, ...]:
    if not robot.cylinders:
        return ()
    return _entries(
        robot, (topics.CHAMBER_PRESSURES, "effort"), robot.pressure_names, wanted=wanted
    )


def _chambers(robot: Robot) -> list[str]:
    return [name for name in robot.pressure_names if "/" in name]


def _bringup(robot: Robot) -> View:
    joints, valves = robot.joint_names, robot.valve_names
    dry = () if robot.cylinders else joints
    warm = Signal(
        topics.OIL_TEMPERATURE, "temperature", "oil", colour=_colour(robot, "", 2, False)
    )
    oil = (warm,) if robot.cylinders else ()
    return View(
        "bringup",
        (
            (
                Plot(
                    "joints, rad or m", _entries(robot, (topics.JOINT_STATES, "position"), joints)
                ),
                Plot("torques, N m or N", _entries(robot, (topics.JOINT_STATES, "effort"), dry)),
            ),
            (
                Plot("chambers, Pa absolute", _pressures(robot, _chambers(robot))),
                Plot("rails, Pa absolute", _pressures(robot, ("supply", "tank"))),
            ),
            (
                Plot("valves applied, V", _entries(robot, (topics.VALVE_STATE, "effort"), valves)),
                Plot("spools", _entries(robot, (topics.VALVE_STATE, "position"), valves)),
                Plot("oil, deg C", oil),
            ),
        ),
        diagnostics=True,
    )


def _tracking(robot: Robot) -> View:
    joints, valves = robot.joint_names, robot.valve_names
    tip = tuple(
        Signal(topics.TIP_REFERENCE, f"point.{axis}", axis, colour=_colour(robot, "", k, False))
        for k, axis in enumerate("xyz")
    )

    def both(joint: str, field: str) -> tuple[Signal, ...]:
        return (
            *_entries(robot, (topics.JOINT_REFERENCE, field), joints, "wanted", (joint,)),
            *_entries(robot, (topics.JOINT_STATES, field), joints, "measured", (joint,)),
        )

    return View(
        "tracking",
        (
            tuple(Plot(f"{j} position", both(j, "position")) for j in joints),
            tuple(Plot(f"{j} velocity", both(j, "velocity")) for j in joints),
            (
                Plot("tip wanted, m", tip),
                Plot("valves asked, V", _entries(robot, (topics.VALVE_COMMAND, "effort"), valves)),
            ),
        ),
    )


def _diagnosis(robot: Robot) -> View:
    joints, valves = robot.joint_names, robot.valve_names
    driven = [c.joint for c in robot.cylinders]
    forces = _entries(robot, (topics.JOINT_REFERENCE, "effort"), joints, "required", driven)

    def volts(valve: str) -> tuple[Signal, ...]:
        return (
            *_entries(robot, (topics.VALVE_COMMAND, "effort"), valves, "asked", (valve,)),
            *_entries(robot, (topics.VALVE_STATE, "effort"), valves, "applied", (valve,)),
        )

    return View(
        "diagnosis",
        (
            tuple(
                Plot(f"{c.name}, Pa absolute", _pressures(robot, (f"{c.name}/a", f"{c.name}/b")))
                for c in robot.cylinders
            ),
            tuple(Plot(f"{valve}, V", volts(valve)) for valve in valves),
            (
                Plot("spools", _entries(robot, (topics.VALVE_STATE, "position"), valves)),
                Plot("velocities", _entries(robot, (topics.JOINT_STATES, "velocity"), joints)),
            ),
            (
                Plot("piston forces, N", forces),
                Plot("rails, Pa absolute", _pressures(robot, ("supply", "tank"))),
            ),
        ),
    )
