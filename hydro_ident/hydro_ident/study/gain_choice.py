"""Gains of the controller, compared over random machines before any comparison run.

    python -m hydro_ident.study.gain_choice [--seeds N N ...]

Each machine is driven along the reference path with its exact base model, and with the two
nominal models of the demo's table. A candidate is sound where none of the runs exceeds the
reference's speed by more than 2 %. The exact model's smallest error wins among the candidates that
are sound and whose neighbours on the grid all are, so that no single gain stands at a cliff. The
machines are `random_truth` of the seeds, not the one that the demo compares rows on.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import Truth
from hydro_ident.errors import IdentError
from hydro_ident.identify.identified_robot import with_edge_coefficient, with_viscous_friction
from hydro_ident.recordings.metrics import TRUTH_HALF_WIDTH, Tracking, tracking
from hydro_ident.study.closed_loop import run_closed_loop
from hydro_model.command_line.command import Parser, run_command
from hydro_model.description.urdf import standard_parameters
from hydro_model.motion.paths import load_path
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

#: Machines with force margin on the path: of the first six, 102 cannot hold its load there.
DEFAULT_SEEDS = (101, 103, 104, 105, 106)
SOUND_SPEED_EXCESS = 0.02
#: 2.9 ms at 500 Hz: a delay of the order of the cycle of delay that the bus has anyway.
FILTER_WEIGHT = 0.5
PRINTED_NOMINAL = 6.30e-7
MODELS = ("exact", "nominal_35bar", "nominal_70bar")
START_DELAY_S = 1.0


#: k_f, k_p, k_v and k_x of eqs. 19 to 23, in the units of `Gains`.
GRID = ((3.0e-8, 6.0e-8), (15.0, 20.0), (1.0e4, 2.0e4), (0.0, 5.0e-3))


def candidates() -> Iterable[Gains]:
    """The grid: force gain, position gain and velocity gains; the filters are argued apart."""
    return (gains_of(point) for point in product(*GRID))


def gains_of(point: Sequence[float]) -> Gains:
    """The gains of a point of the grid."""
    k_f, k_p, k_v, k_x = point
    return Gains(
        k_p_1_s=k_p,
        k_v=k_v,
        k_f_m2_ns=k_f,
        k_x_m=k_x,
        alpha_qd=FILTER_WEIGHT,
        alpha_p=FILTER_WEIGHT,
        alpha_fd=FILTER_WEIGHT,
    )


def exact_model(robot: Robot, truth: Truth) -> Robot:
    """The base model with the machine's own numbers: what identification could reach at best."""
    links = [standard_parameters(t.mass_kg, t.com_m, t.inertia_com_kg_m2) for t in truth.links]
    bulk = truth.fluid.bulk_modulus_pa
    valves = tuple(
        replace(v, c_pa=t.c_pa, c_at=t.c_at, c_pb=t.c_pb, c_bt=t.c_bt)
        for v, t in zip(robot.valves, truth.valves, strict=True)
    )
    cylinders = tuple(
        replace(c, bulk_modulus_pa=bulk, barrel=t.barrel, rod=t.rod)
        for c, t in zip(robot.cylinders, truth.cylinders, strict=True)
    )
    exact = replace(robot, link_inertia=np.array(links), valves=valves, cylinders=cylinders)
    return with_viscous_friction(exact, _friction(truth))


def _friction(truth: Truth) -> dict[str, float]:
    return {c.name: c.viscous_friction for c in truth.cylinders}


def models(robot: Robot, truth: Truth) -> dict[str, Robot]:
    """The models of `MODELS` for one machine."""
    nominal = with_viscous_friction(robot, _friction(truth))
    printed = with_edge_coefficient(nominal, PRINTED_NOMINAL)
    return dict(zip(MODELS, (exact_model(robot, truth), nominal, printed), strict=True))


def track(robot: Robot, truth: Truth, model: Robot, gains: Gains, seed: int = 0) -> Tracking:
    """Tracking figures of one run along the reference path.

    `model` is the controller's.
    """
    path = load_path("xs031/parallelogram")
    start_m = path.sample(0.0)[0]
    rig = RigCore(robot, truth, seed=seed, tip_m=start_m.tolist())
    core = ControllerCore(model, gains, path, start_delay_s=START_DELAY_S)
    run = run_closed_loop(rig, core, path.duration_s + START_DELAY_S + 0.5)
    stamp_ns = np.round(run.time_s * 1e9).astype(np.int64)
    return tracking(stamp_ns, run.tip_m, run.tip_reference_m, half_width=TRUTH_HALF_WIDTH)


@dataclass(frozen=True, slots=True)
class Score:
    """A candidate over all machines: geometric mean of the RMSE, largest speed excess."""

    gains: Gains
    rmse_mm: dict[str, float]
    speed_excess: float


def score(robot: Robot, truths: Sequence[Truth], gains: Gains) -> Score:
    """Score one candidate."""
    rmse: dict[str, list[float]] = {name: [] for name in MODELS}
    excess = -1.0
    for truth in truths:
        for name, model in models(robot, truth).items():
            row = track(robot, truth, model, gains)
            rmse[name].append(row.rmse_mm)
            excess = max(excess, row.max_speed_m_s / row.reference_speed_m_s - 1.0)
    means = {name: float(np.exp(np.mean(np.log(values)))) for name, values in rmse.items()}
    return Score(gains, means, excess)


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="gain_choice", description=__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=list(DEFAULT_SEEDS), help="machines"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    options = parser.parse_args(arguments)
    robot = load_robot("xs031")
    truths = [random_truth(robot, seed) for seed in options.seeds]
    print("seeds", *options.seeds)
    print("| k_f | k_p | k_v | k_x | exact mm | 35 bar mm | 70 bar mm | speed excess | |")
    print("|---|---|---|---|---|---|---|---|---|")
    scores = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for done in pool.map(partial(score, robot, truths), candidates()):
            scores.append(done)
            print(_row(done), flush=True)
    best = choice(scores)
    if best is None:
        print("gain_choice: no candidate is sound with all its neighbours", file=sys.stderr)
        return 1
    print("chosen:", _row(best))
    return 0


def choice(scores: Sequence[Score]) -> Score | None:
    """The smallest error of the exact model among those sound with all their neighbours."""
    points = list(product(*GRID))
    if len(scores) != len(points):
        raise IdentError(f"expected {len(points)} scores, one per candidate, found {len(scores)}")
    sound = [s.speed_excess <= SOUND_SPEED_EXCESS for s in scores]
    steady = [
        score
        for score, point in zip(scores, points, strict=True)
        if all(sound[i] for i, other in enumerate(points) if _steps(point, other) <= 1)
    ]
    return min(steady, key=lambda s: s.rmse_mm["exact"], default=None)


def _steps(point: Sequence[float], other: Sequence[float]) -> int:
    """Number of gains in which two points of the grid differ (each has two values)."""
    return sum(a != b for a, b in zip(point, other, strict=True))


def _row(s: Score) -> str:
    g = s.gains
    sound = "sound" if s.speed_excess <= SOUND_SPEED_EXCESS else ""
    errors = " | ".join(f"{s.rmse_mm[name]:.2f}" for name in MODELS)
    head = f"| {g.k_f_m2_ns:g} | {g.k_p_1_s:g} | {g.k_v:g} | {g.k_x_m:g}"
    return f"{head} | {errors} | {s.speed_excess:+.1%} | {sound} |"


def main() -> int:
    """Entry point of `python -m hydro_ident.study.gain_choice`."""
    return run_command("gain_choice", _run)


if __name__ == "__main__":
    sys.exit(main())
