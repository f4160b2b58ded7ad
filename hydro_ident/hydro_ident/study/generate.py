"""Cases of the study: from a seed to recordings that say nothing of what is hidden in them.

A case is a random machine of one of the study's cranes, plain but for what is hidden, and two
recordings, one to learn from and one to verify on. Everything random follows from the study's
seed and the case's number. Clean machines, machines with effects and machines with physics that no
catalogue has are drawn alike: the same cranes, motions, noise, durations and files.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_ident.errors import IdentError
from hydro_ident.study.detection_limit import Detectability, detectability
from hydro_ident.study.experiments import Kind, Motion, work
from hydro_ident.study.hidden import (
    Hidden,
    Machine,
    Scene,
    log_uniform,
    machine_extras,
    with_truth,
)
from hydro_ident.study.hidden_flow import FLOW_EFFECTS
from hydro_ident.study.hidden_force import FORCE_EFFECTS
from hydro_ident.study.hidden_readings import OUTSIDE_EFFECTS, READING_EFFECTS
from hydro_ident.study.robots import StudyRobot
from hydro_ident.study.traces import Drive, drive, scene_of

CaseKind = Literal["clean", "single", "double", "triple", "outside"]
#: Shares of 750 cases: 300 clean, 300 with effects, 150 with physics of no catalogue.
SHARES: dict[CaseKind, float] = {
    "clean": 0.40,
    "single": 0.26,
    "double": 0.09,
    "triple": 0.05,
    "outside": 0.20,
}
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
#: No chamber of a sound machine comes near vapour pressure: gauge, Pa.
_LOWEST_PA = 5.0e4
_TRIES = 40


@dataclass(frozen=True, slots=True)
class CaseSpec:
    """Which case: everything else follows.

    Attributes
    ----------
    seed : int
        Of the study.
    index : int
    kind : {"clean", "single", "double", "triple", "outside"}
    """

    seed: int
    index: int
    kind: CaseKind

    @property
    def name(self) -> str:
        """What the case's files are called: digits that say nothing."""
        return digest("case", self.seed, self.index)

    def random(self, *parts: int) -> np.random.Generator:
        """A generator of this case for one purpose."""
        return np.random.default_rng([self.seed, self.index, *parts])


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


@dataclass(frozen=True, slots=True)
class Case:
    """A case before it is written.

    Attributes
    ----------
    spec : CaseSpec
    robot : StudyRobot
    machine : Machine
    motion : {"excite", "work"}
    planted : tuple of Planted
    train, check : Drive
    at : dict of str to float
        Operating point of the sizes, by effect.
    """

    spec: CaseSpec
    robot: StudyRobot
    machine: Machine
    motion: Kind
    planted: tuple[Planted, ...]
    train: Drive
    check: Drive
    at: dict[str, dict[str, float]]


def digest(*parts: object) -> str:
    """Twelve hexadecimal digits that tell nothing of the parts."""
    text = ":".join(str(part) for part in parts)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def kinds(seed: int, cases: int) -> list[CaseKind]:
    """The kind of every case, in an order that the seed shuffles."""
    exact = {kind: share * cases for kind, share in SHARES.items()}
    counts = {kind: int(value) for kind, value in exact.items()}
    by_rest = sorted(SHARES, key=lambda kind: counts[kind] - exact[kind])
    for kind in by_rest[: cases - sum(counts.values())]:
        counts[kind] += 1
    order = [kind for kind, count in counts.items() for _ in range(count)]
    np.random.default_rng([seed, 1]).shuffle(order)
    return order


def make_case(spec: CaseSpec, robots: list[StudyRobot]) -> Case:
    """Draw a case.

    Parameters
    ----------
    spec : CaseSpec
    robots : list of StudyRobot
        The study's cranes.

    Returns
    -------
    Case

    Raises
    ------
    IdentError
        No draw of this case gives a machine that works.
    """
    reason = ""
    for attempt in range(_TRIES):
        try:
            case = _attempt(spec, robots, attempt)
        except (BridgeError, IdentError) as error:
            reason = str(error)
            continue
        if case is not None:
            return case
        reason = "the machine cavitates or its effect cannot be made visible"
    raise IdentError(
        f"case {spec.index} of seed {spec.seed}: {_TRIES} draws failed, last: {reason}"
    )


def _attempt(spec: CaseSpec, robots: list[StudyRobot], attempt: int) -> Case | None:
    random = spec.random(attempt, 0)
    robot = robots[int(random.integers(len(robots)))]
    train_motion, check_motion = _motions(robot, random)
    plain = _plain_machine(robot, random)
    noise = [int(v) for v in random.integers(1 << 31, size=2)]
    base = drive(plain, train_motion, noise[0])
    if not _sound(base):
        return None
    scene = scene_of(base)
    planted = _plant(spec, plain, scene, train_motion, noise[0], spec.random(attempt, 1))
    if planted is None:
        return None
    machine = plain
    for one in planted:
        machine = one.hidden.apply(machine, scene, one.index, one.size, one.seed)
    # Where nothing is hidden the first run is this one already.
    train = drive(machine, train_motion, noise[0]) if planted else base
    check = _check(machine, check_motion, noise[1])
    if not (_sound(train) and _sound(check)):
        return None
    if len(planted) == 1:
        # What was hidden, not what the draft of it suggested.
        planted = (_settled(planted[0], train, plain),)
    at = {one.hidden.name: _operating_point(one, machine, scene, train) for one in planted}
    return Case(spec, robot, machine, train_motion.kind, planted, train, check, at)


def _check(machine: Machine, motion: Motion, noise: int) -> Drive:
    """The second run: other disturbances, and the payload from the start."""
    seed = machine.truth.extras.machine.process_seed + 1
    other = machine_extras(machine, process_seed=seed)
    if machine.payload is not None:
        share = machine.payload.from_s / 60.0
        other = replace(other, payload=replace(machine.payload, from_s=40.0 * share))
    return drive(other, motion, noise)


def _motions(robot: StudyRobot, random: np.random.Generator) -> tuple[Motion, Motion]:
    if random.random() < 0.5:
        return robot.excitation
    for _ in range(4):
        try:
            return work(robot.robot, int(random.integers(1 << 30)))
        except IdentError:
            continue
    return robot.excitation


def _plain_machine(robot: StudyRobot, random: np.random.Generator) -> Machine:
    truth = plain_truth(robot.robot, int(random.integers(1 << 31)))
    recorded = bool(random.random() < 0.6)
    machine = Machine(robot.robot, truth, lines_recorded=recorded)
    if recorded:
        # On record, a supply that gives way is no riddle.
        supply = replace(
            truth.supply,
            pressure_pa=truth.supply.pressure_pa * float(random.uniform(0.96, 1.02)),
            droop=float(random.uniform(0.0, 6.0e8)),
            tank_resistance=float(random.uniform(0.0, 2.0e11)),
        )
        machine = with_truth(machine, supply=supply)
    return machine


def _sound(run: Drive) -> bool:
    n, m = run.machine.robot.dof, len(run.machine.robot.cylinders)
    pressures = run.track.states[:, 2 * n : 2 * n + 2 * m]
    limits = [(j.lower, j.upper) for j in run.machine.robot.joints]
    lower, upper = np.array(limits).T
    q = run.track.states[:, :n]
    inside = bool((q > lower - 0.02).all() and (q < upper + 0.02).all())
    return inside and float(pressures.min()) > _LOWEST_PA and float(pressures.max()) < 24.0e6


def _plant(
    spec: CaseSpec,
    plain: Machine,
    scene: Scene,
    motion: Motion,
    noise: int,
    random: np.random.Generator,
) -> tuple[Planted, ...] | None:
    """Effects of the case's kind with their sizes, or None where none can be seen."""
    table = OUTSIDE if spec.kind == "outside" else KNOWN
    planted: list[Planted] = []
    for _ in range(12):
        if len(planted) == COUNTS[spec.kind]:
            break
        hidden = table[str(random.choice(list(table)))]
        index = int(random.integers(len(plain.robot.cylinders)))
        if _clashes(hidden, planted) or not hidden.needs(plain, index):
            continue
        one = _sized(hidden, index, plain, scene, motion, noise, random)
        if one is not None:
            planted.append(one)
    return tuple(planted) if len(planted) == COUNTS[spec.kind] else None


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
        visible = _settled(draft, run, plain).visible
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


def _settled(one: Planted, run: Drive, plain: Machine) -> Planted:
    """The effect with its visibility in a run."""
    visible = detectability(
        run, _reference(plain, one.hidden), one.size, delay=one.hidden.name not in _SHIFTED
    )
    return replace(one, visible=visible)


def _operating_point(one: Planted, machine: Machine, scene: Scene, run: Drive) -> dict[str, float]:
    cylinder = machine.robot.cylinders[one.index]
    joint = machine.robot.joint_index(cylinder.joint)
    axes = machine.truth.extras.axes
    volume = axes[one.index].line_volume if axes else 0.0
    temperature = oil_temperature(machine, one.index, np.array([0.0, scene.duration_s]))
    return {
        "lever": float(np.median(np.abs(scene.lever[:, one.index]))),
        "inertia_kg_m2": float(scene.inertia[joint]),
        "lowest_tip_m": float(scene.tip_height_m.min()),
        "duration_s": scene.duration_s,
        "cycle_s": run.track.cycle_s,
        "bulk_modulus_pa": machine.truth.fluid.bulk_modulus_pa,
        "line_volume_m3": float(volume),
        "coldest_c": float(temperature[0]),
        "warmest_c": float(temperature[1]),
    }


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


def truth_record(case: Case) -> dict[str, Any]:
    """What is kept apart from the recordings: kind, effects, sizes, limits, channels."""
    robot = case.machine.robot
    effects = []
    for one in case.planted:
        whole = one.hidden.scope == "robot"
        effects.append(
            {
                "name": one.hidden.name,
                "known": one.hidden.known,
                "target": robot.name if whole else robot.cylinders[one.index].joint,
                "size": one.size,
                "unit": one.hidden.unit,
                "stated_at": one.hidden.at,
                "limit": one.visible.limit,
                "ratio": one.size / one.visible.limit,
                "channels": list(one.visible.channels),
                "shares": {k: round(v, 6) for k, v in one.visible.shares.items()},
                "at": case.at[one.hidden.name],
            }
        )
    return {
        "schema": "hydro_ident/study_truth/1",
        "case": case.spec.name,
        "index": case.spec.index,
        "seed": case.spec.seed,
        "kind": case.spec.kind,
        "motion": case.motion,
        "lines_recorded": case.machine.lines_recorded,
        "effects": effects,
    }
