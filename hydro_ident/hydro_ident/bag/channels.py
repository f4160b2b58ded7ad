"""Which channels a bag can give, and why not the others (the contract's "Bags")."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from hydro_ident.bag.rails import LONGEST_S
from hydro_model.robot import Cylinder, Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_STATE


@dataclass(frozen=True, slots=True)
class Loss:
    """A channel (or measured constant) that a bag does not give.

    Attributes
    ----------
    channel : str
        `<joint>/force`, `<joint>/flow_a`, `<joint>/flow_b`, `<joint>/torque`; `supply` or
        `tank` where the robot file's constant stands in or that was not read for long.
    reason : str
    stands : bool
        Of a bag that is read piece by piece: said although other pieces give the channel.
    """

    channel: str
    reason: str
    stands: bool = False


@dataclass(frozen=True, slots=True)
class Present:
    """Which columns of a recording have readings; None for what was not recorded at all.

    Attributes
    ----------
    q : (n,) sequence of bool
    stroke : (m,) sequence of bool or None
    effort : (n,) sequence of bool or None
    chambers : (m,) sequences of bool or None
        Pressures of chambers A and of chambers B.
    silent_s : floats or None
        Longest time without a reading of supply and of tank, s.
    valve_v : (m,) sequence of bool or None
    """

    q: Sequence[bool]
    stroke: Sequence[bool] | None
    effort: Sequence[bool] | None
    chambers: tuple[Sequence[bool] | None, Sequence[bool] | None]
    silent_s: tuple[float | None, float | None]
    valve_v: Sequence[bool] | None

    @property
    def hydraulic(self) -> bool:
        """Some chamber's pressures were recorded."""
        return any(p is not None for p in self.chambers)


def _missing(values: Sequence[bool] | None, column: int) -> bool:
    return values is None or not values[column]


def channels_of(robot: Robot, *, torque: bool = False) -> tuple[str, ...]:
    """Every residual channel of a robot.

    Parameters
    ----------
    robot : Robot
    torque : bool
        Of a robot with measured joint torque instead of pressures.

    Returns
    -------
    tuple of str
    """
    driven = {c.joint for c in robot.cylinders}
    names = []
    for joint in robot.joint_names:
        if torque or joint not in driven:
            names.append(f"{joint}/torque")
        else:
            names += [f"{joint}/{kind}" for kind in ("force", "flow_a", "flow_b")]
    return tuple(names)


def find_losses(
    robot: Robot,
    present: Present,
    *,
    valve_source: str,
    valve_there: str = "",
    valve_stamps: str = "",
    dead: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Loss, ...]:
    """Every channel lost, with its reason.

    Parameters
    ----------
    robot : Robot
    present : Present
    valve_source : str
        Topic of the valves' voltages, or empty.
    valve_there : str
        A topic of valves that has messages, be they of voltages or not; or empty.
    valve_stamps : str
        What is wrong with the stamps of the valves' topic.
    dead : mapping of str to float
        As of `Recording`.

    Returns
    -------
    tuple of Loss
    """
    losses: list[Loss] = []
    blind = [j for i, j in enumerate(robot.joint_names) if _missing(present.q, i)]
    chambers, hydraulic = present.chambers, present.hydraulic
    for i, cylinder in enumerate(robot.cylinders):
        joint = cylinder.joint
        position = _position_reason(robot, cylinder, i, blind, present.stroke)
        valve = _valve_reason(
            robot, cylinder, present.valve_v, (valve_source, valve_there), valve_stamps
        )
        dry = [_chamber_reason(robot, i, side, chambers, dead) for side in (0, 1)]
        reasons = {
            f"{joint}/force": [*dict.fromkeys(r for r in dry if r), *_angles_reason(blind)],
            f"{joint}/flow_a": [r for r in (dry[0], position, valve) if r],
            f"{joint}/flow_b": [r for r in (dry[1], position, valve) if r],
        }
        stands = any(f"{cylinder.name}/{side}" in dead for side in "ab")
        losses += [Loss(c, "; ".join(why), stands) for c, why in reasons.items() if why]
    losses += _torque_losses(robot, present.effort, hydraulic, blind, dead)
    return (*losses, *(_rail_losses(robot, present.silent_s) if hydraulic else ()))


def _torque_losses(
    robot: Robot,
    effort: Sequence[bool] | None,
    hydraulic: bool,
    blind: list[str],
    dead: Mapping[str, float],
) -> list[Loss]:
    """Torques of joints whose force no pressure gives."""
    losses = []
    torques = effort is not None or any(name.endswith(" effort") for name in dead)
    driven = {c.joint for c in robot.cylinders} if hydraulic or not torques else set()
    for i, joint in enumerate(robot.joint_names):
        if joint in driven:
            continue
        reading = dead.get(f"{joint} effort") if _missing(effort, i) else None
        why = [f"no effort of {joint} in {JOINT_STATES}"] if _missing(effort, i) else []
        if reading is not None:
            why = [f"effort of {joint} reads {reading:g} throughout while the robot moves"]
        why += _angles_reason(blind)
        if why:
            losses.append(Loss(f"{joint}/torque", "; ".join(why), stands=reading is not None))
    return losses


def _rail_losses(robot: Robot, silent: tuple[float | None, float | None]) -> Iterator[Loss]:
    """Rails that were not recorded, or not read for so long that nobody knows what they did."""
    constants = (robot.supply_pressure_pa, robot.tank_pressure_pa)
    for name, silent_s, constant in zip(("supply", "tank"), silent, constants, strict=True):
        if silent_s is None:
            text = f"not in {CHAMBER_PRESSURES}: the robot file's {constant / 1e5:g} bar used"
            yield Loss(name, text, stands=True)
            continue
        if silent_s > LONGEST_S:
            how = f"for {silent_s:.1f} s at a time" if np.isfinite(silent_s) else "for a while"
            text = f"not in {CHAMBER_PRESSURES} {how}: flows are left out there"
            yield Loss(name, text, stands=True)


def _angles_reason(blind: list[str]) -> list[str]:
    """Gravity and inertia of a serial chain couple every force to every angle."""
    return [f"no position of {', '.join(blind)} in {JOINT_STATES}"] if blind else []


def _position_reason(
    robot: Robot, cylinder: Cylinder, column: int, blind: list[str], stroke: Sequence[bool] | None
) -> str:
    if cylinder.joint not in blind or not _missing(stroke, column):
        return ""
    return f"no position of {cylinder.joint} and no stroke of {cylinder.name} in {JOINT_STATES}"


def _chamber_reason(
    robot: Robot,
    i: int,
    side: int,
    chambers: tuple[Sequence[bool] | None, Sequence[bool] | None],
    dead: Mapping[str, float],
) -> str:
    cylinder = robot.cylinders[i]
    reading = dead.get(f"{cylinder.name}/{'ab'[side]}")
    if reading is not None and _missing(chambers[side], i):
        bar = (reading + robot.atmospheric_pressure_pa) / 1e5
        name = f"{cylinder.name}/{'ab'[side]}"
        return f"{name} reads {bar:g} bar throughout while {cylinder.joint} moves"
    if all(p is None for p in chambers):
        return f"no {CHAMBER_PRESSURES}"
    if _missing(chambers[side], i):
        return f"no {cylinder.name}/{'ab'[side]} in {CHAMBER_PRESSURES}"
    return ""


def _valve_reason(
    robot: Robot,
    cylinder: Cylinder,
    valve_v: Sequence[bool] | None,
    topics: tuple[str, str],
    stamps: str,
) -> str:
    """`topics`: that of the voltages, and one that is there without them."""
    columns = [k for k, v in enumerate(robot.valves) if v.cylinder == cylinder.name]
    if not columns:
        return f"robot {robot.name} has no valve for {cylinder.name}"
    if stamps:
        return stamps
    (source, there), name = topics, robot.valves[columns[0]].name
    if valve_v is None and there:
        return f"no voltage (effort) of {name} in {there}"
    if valve_v is None:
        return f"no {VALVE_COMMAND} or {VALVE_STATE}"
    return f"no {name} in {source}" if _missing(valve_v, columns[0]) else ""
