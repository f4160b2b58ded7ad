"""What is hidden in a machine of the study, and how large, so that it can be seen at all."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from hydro_hw_bridge.rig.random_truth import log_uniform
from hydro_ident.study.detection_limit import Detectability, detectability
from hydro_ident.study.experiments import Motion
from hydro_ident.study.hidden import (
    Hidden,
    Machine,
    Scene,
    machine_extras,
)
from hydro_ident.study.hidden_flow import FLOW_EFFECTS
from hydro_ident.study.hidden_force import FORCE_EFFECTS
from hydro_ident.study.hidden_readings import OUTSIDE_EFFECTS, READING_EFFECTS
from hydro_ident.study.traces import Drive, drive
from hydro_model.robot import FloatArray

CaseKind = Literal["clean", "single", "double", "triple", "outside"]
COUNTS: dict[CaseKind, int] = {"clean": 0, "single": 1, "double": 2, "triple": 3, "outside": 1}
KNOWN = {h.name: h for h in (*FORCE_EFFECTS, *FLOW_EFFECTS, *READING_EFFECTS)}
OUTSIDE = {h.name: h for h in OUTSIDE_EFFECTS}
#: Of sizes drawn near the limit of detection; the others lie anywhere in the physical range.
_NEAR = 0.6
_NEAR_RANGE = (0.5, 10.0)
#: Effects of which one machine has at most one: they share parts of the truth plant.
_EXCLUSIVE = (
    {"coulomb_friction", "presliding_friction"},
    {"valve_spool_lag", "valve_rate_limit"},
    {"command_delay", "valve_spool_lag"},
    {"backlash", "structural_flexibility"},
    {"counterbalance_valve", "end_cushion"},
    {"line_dynamics", "dead_volume"},
    {"external_contact", "payload_change"},
)
#: Seen against a machine whose command is already a whole cycle late, as a refit may make it.
_SHIFTED = ("command_delay", "valve_spool_lag")


@dataclass(frozen=True, slots=True)
class Planted:
    """An effect as hidden.

    Attributes
    ----------
    hidden : Hidden
    index : int
        Cylinder it acts on.
    size : float
    seed : int
        Of its shape.
    visible : Detectability
    """

    hidden: Hidden
    index: int
    size: float
    seed: int
    visible: Detectability


def plant(
    kind: CaseKind,
    plain: Machine,
    scene: Scene,
    motion: Motion,
    noise: int,
    random: np.random.Generator,
) -> tuple[Planted, ...] | None:
    """Effects of the case's kind with their sizes, or None where none can be seen.

    `noise` is its seed.
    """
    table = OUTSIDE if kind == "outside" else KNOWN
    planted: list[Planted] = []
    for _ in range(12):
        if len(planted) == COUNTS[kind]:
            break
        hidden = table[str(random.choice(list(table)))]
        index = int(random.integers(len(plain.robot.cylinders)))
        if _clashes(hidden, planted) or not hidden.needs(plain, index):
            continue
        if not hidden.shows(plain, scene, index):
            continue
        one = _sized(hidden, index, plain, scene, motion, noise, random)
        if one is not None:
            planted.append(one)
    return tuple(planted) if len(planted) == COUNTS[kind] else None


def _clashes(hidden: Hidden, planted: list[Planted]) -> bool:
    names = {one.hidden.name for one in planted}
    if hidden.name in names:
        return True
    return any(hidden.name in group and names & group for group in _EXCLUSIVE)


def _sized(
    hidden: Hidden,
    index: int,
    plain: Machine,
    scene: Scene,
    motion: Motion,
    noise: int,
    random: np.random.Generator,
) -> Planted | None:
    """An effect with a size about the limit of detection, or anywhere in its range."""
    seed = int(random.integers(1 << 31))
    size = float(np.sqrt(hidden.low * hidden.high))
    visible = None
    # The trace of some effects does not grow like their size: look again near the limit.
    for _ in range(1 if hidden.linear else 3):
        draft = Planted(hidden, index, size, seed, Detectability(0.0, np.inf, {}))
        run = drive(
            hidden.apply(_reference(plain, hidden), scene, index, size, seed), motion, noise
        )
        visible = settled(draft, run, plain).visible
        size = min(max(2.0 * visible.limit, hidden.low), hidden.high)
    if visible is None or _NEAR_RANGE[0] * visible.limit > hidden.high:
        return None
    near = bool(random.random() < _NEAR)
    low, high = hidden.low, hidden.high
    if near:
        low, high = (factor * visible.limit for factor in _NEAR_RANGE)
        low, high = max(low, hidden.low), min(max(high, 3.0 * hidden.low), hidden.high)
    else:
        low = max(low, _NEAR_RANGE[0] * visible.limit)
    return Planted(hidden, index, log_uniform(random, min(low, high), high), seed, visible)


def _reference(plain: Machine, hidden: Hidden) -> Machine:
    if hidden.name not in _SHIFTED:
        return plain
    return machine_extras(plain, command_delay_s=1.0 / plain.robot.sensors.rate_hz)


def settled(one: Planted, run: Drive, plain: Machine) -> Planted:
    """The effect with its visibility in a run."""
    visible = detectability(
        run, _reference(plain, one.hidden), one.size, delay=one.hidden.name not in _SHIFTED
    )
    return replace(one, visible=visible)


def operating_point(one: Planted, machine: Machine, scene: Scene, run: Drive) -> dict[str, float]:
    """Numbers at which an effect's size is stated, by name; their units end the names."""
    cylinder = machine.robot.cylinders[one.index]
    joint = machine.robot.joint_index(cylinder.joint)
    axes = machine.truth.extras.axes
    volume = axes[one.index].line_volume if axes else 0.0
    temperature = oil_temperature(machine, one.index, np.array([0.0, scene.duration_s]))
    other = int(axes[one.index].coupling_joint) if axes else 0
    return {
        "lever": float(np.median(np.abs(scene.lever[:, one.index]))),
        "inertia_kg_m2": float(scene.inertia[joint]),
        "fast_m_s": scene.fast_m_s(one.index),
        "lowest_tip_m": float(scene.tip_height_m.min()),
        "duration_s": scene.duration_s,
        "cycle_s": run.track.cycle_s,
        "bulk_modulus_pa": machine.truth.fluid.bulk_modulus_pa,
        "line_volume_m3": float(volume),
        "coldest_c": float(temperature[0]),
        "warmest_c": float(temperature[1]),
        "signal": usual(run.track.commands[:, one.index]),
        "other_rad_s": usual(run.track.states[:, machine.robot.dof + other]),
    }


def usual(values: FloatArray) -> float:
    """The size at which a line through 0, fitted to what bends, meets it.

    Parameters
    ----------
    values : (N,) array
        Of what the bent quantity depends on, in any unit.

    Returns
    -------
    float
        Root of the mean fourth power over the mean square: exact for what bends by the cube.
    """
    square = np.square(values)
    return float(np.sqrt(np.sum(square * square) / max(np.sum(square), 1e-300)))


def oil_temperature(machine: Machine, index: int, time_s: Any) -> Any:
    """Oil temperature at times, deg C: constant, or rising where the oil thins out.

    Viscous friction halves with every 17 K.
    """
    axes = machine.truth.extras.axes
    start = machine.truth.sensors.oil_temperature_c
    warming = [
        (a.cooling / c.viscous_friction, a.cooling_time)
        for a, c in zip(axes, machine.truth.cylinders, strict=False)
        if a.cooling > 0.0
    ]
    if not warming:
        return start + 0.0 * time_s
    share, time = warming[0]
    return start - 17.0 * np.log2(1.0 - share * (1.0 - np.exp(-time_s / time)))
