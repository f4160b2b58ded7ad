"""Which channels a bag can give, and why not the others (the contract's "Bags")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.bag.cdr import FloatArray
from hydro_model.robot import Cylinder, Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_STATE


@dataclass(frozen=True, slots=True)
class Loss:
    """A channel (or measured constant) that a bag does not give.

    Attributes
    ----------
    channel : str
        `<joint>/force`, `<joint>/flow_a`, `<joint>/flow_b`, `<joint>/torque`; `supply` or
        `tank` where the robot file's constant stands in.
    reason : str
    """

    channel: str
    reason: str


def _missing(values: FloatArray | None, column: int) -> bool:
    return values is None or bool(np.isnan(values[:, column]).all())


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
    *,
    q: FloatArray,
    stroke: FloatArray | None,
    effort: FloatArray | None,
    chambers: tuple[FloatArray | None, FloatArray | None],
    sources: tuple[FloatArray | None, FloatArray | None],
    valve_v: FloatArray | None,
    valve_source: str,
) -> tuple[Loss, ...]:
    """Every channel lost, with its reason.

    Parameters
    ----------
    robot : Robot
    q : (N, n) array
    stroke : (N, m) array or None
    effort : (N, n) array or None
    chambers : (N, m) arrays or None
        Pressures of chambers A and of chambers B.
    sources : (N,) arrays or None
        Supply and tank.
    valve_v : (N, m) array or None
    valve_source : str
        Topic of `valve_v`.

    Returns
    -------
    tuple of Loss
    """
    losses: list[Loss] = []
    blind = [j for i, j in enumerate(robot.joint_names) if _missing(q, i)]
    hydraulic = any(p is not None for p in chambers)
    for i, cylinder in enumerate(robot.cylinders):
        joint = cylinder.joint
        position = _position_reason(robot, cylinder, i, blind, stroke)
        valve = _valve_reason(robot, cylinder, valve_v, valve_source)
        dry = [_chamber_reason(cylinder, side, chambers, i) for side in (0, 1)]
        reasons = {
            f"{joint}/force": [*dict.fromkeys(r for r in dry if r), *_angles_reason(blind)],
            f"{joint}/flow_a": [r for r in (dry[0], position, valve) if r],
            f"{joint}/flow_b": [r for r in (dry[1], position, valve) if r],
        }
        losses += [Loss(channel, "; ".join(why)) for channel, why in reasons.items() if why]
    driven = {c.joint for c in robot.cylinders} if hydraulic or effort is None else set()
    for i, joint in enumerate(robot.joint_names):
        if joint in driven:
            continue
        why = [f"no effort of {joint} in {JOINT_STATES}"] if _missing(effort, i) else []
        why += _angles_reason(blind)
        if why:
            losses.append(Loss(f"{joint}/torque", "; ".join(why)))
    constants = (robot.supply_pressure_pa, robot.tank_pressure_pa)
    for name, values, constant in zip(("supply", "tank"), sources, constants, strict=True):
        if values is None and hydraulic:
            text = f"not in {CHAMBER_PRESSURES}: the robot file's {constant / 1e5:g} bar used"
            losses.append(Loss(name, text))
    return tuple(losses)


def _angles_reason(blind: list[str]) -> list[str]:
    """Gravity and inertia of a serial chain couple every force to every angle."""
    return [f"no position of {', '.join(blind)} in {JOINT_STATES}"] if blind else []


def _position_reason(
    robot: Robot, cylinder: Cylinder, column: int, blind: list[str], stroke: FloatArray | None
) -> str:
    if cylinder.joint not in blind or not _missing(stroke, column):
        return ""
    return f"no position of {cylinder.joint} and no stroke of {cylinder.name} in {JOINT_STATES}"


def _chamber_reason(
    cylinder: Cylinder, side: int, chambers: tuple[FloatArray | None, FloatArray | None], i: int
) -> str:
    if all(p is None for p in chambers):
        return f"no {CHAMBER_PRESSURES}"
    if _missing(chambers[side], i):
        return f"no {cylinder.name}/{'ab'[side]} in {CHAMBER_PRESSURES}"
    return ""


def _valve_reason(
    robot: Robot, cylinder: Cylinder, valve_v: FloatArray | None, source: str
) -> str:
    columns = [k for k, v in enumerate(robot.valves) if v.cylinder == cylinder.name]
    if not columns:
        return f"robot {robot.name} has no valve for {cylinder.name}"
    if valve_v is None:
        return f"no {VALVE_COMMAND} or {VALVE_STATE}"
    name = robot.valves[columns[0]].name
    return f"no {name} in {source}" if _missing(valve_v, columns[0]) else ""
