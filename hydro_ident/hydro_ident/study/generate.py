"""Cases of the study: from a seed to recordings that say nothing of what is hidden in them.

A case is a random machine of one of the study's cranes, plain but for what is hidden, and two
recordings, one to learn from and one to verify on. Everything random follows from the study's
seed and the case's number. Clean machines, machines with effects and machines with physics that no
catalogue has are drawn alike: the same cranes, motions, noise, durations and files.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_ident.errors import IdentError
from hydro_ident.study.experiments import Kind, Motion, work
from hydro_ident.study.hidden import (
    Machine,
    machine_extras,
    with_truth,
)
from hydro_ident.study.planting import (
    CaseKind,
    Planted,
    operating_point,
    plant,
    settled,
)
from hydro_ident.study.robots import StudyRobot
from hydro_ident.study.traces import Drive, drive, scene_of

#: Shares of 750 cases: 300 clean, 300 with effects, 150 with physics of no catalogue.
SHARES: dict[CaseKind, float] = {
    "clean": 0.40,
    "single": 0.26,
    "double": 0.09,
    "triple": 0.05,
    "outside": 0.20,
}
#: No chamber of a sound machine comes near vapour pressure: gauge, Pa.
_LOWEST_PA = 5.0e4
#: Steps of a normalised valve command from cycle to cycle, root mean square over so long, with
#: which nobody would go on.
_CHATTER, _CHATTER_S = 0.1, 0.1
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
    """The kind of every case, in an order that the seed shuffles.

    `cases` is how many.
    """
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
    planted = plant(spec.kind, plain, scene, train_motion, noise[0], spec.random(attempt, 1))
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
        planted = (settled(planted[0], train, plain),)
    at = {one.hidden.name: operating_point(one, machine, scene, train) for one in planted}
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
    safe = float(pressures.min()) > _LOWEST_PA and float(pressures.max()) < 24.0e6
    return inside and safe and not _chatters(run)


def _chatters(run: Drive) -> bool:
    """Whether the servo throws a valve to and fro from cycle to cycle."""
    steps = np.diff(run.track.commands, axis=0) ** 2
    window = max(1, round(_CHATTER_S / run.track.cycle_s))
    total = np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
    return bool(((total[window:] - total[:-window]) / window > _CHATTER**2).any())


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
