"""A payload taken up mid-run along the parallelogram, with and without online adaptation.

    python -m hydro_ident.study.adaptation [--seeds N N ...] [--models exact nominal_35bar]

Every machine is driven along the reference path by a fixed model; at `--at` seconds a point mass
appears at its tip, and after the path it is held for a while. Printed: RMSE and largest error of
the true tip before and after the instant, the payload as estimated at the instant and at the end,
the errors of the friction and null bias estimates, and how far estimates move while holding.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_control.adaptation.adaptation_settings import KINDS, AdaptationSettings
from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.payload import Payload
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import Truth
from hydro_ident.recordings.metrics import TRUTH_HALF_WIDTH, speed_m_s
from hydro_ident.study.closed_loop import Run, run_closed_loop
from hydro_ident.study.gain_choice import DEFAULT_SEEDS, START_DELAY_S, models
from hydro_model.command_line.command import Parser, run_command
from hydro_model.motion.paths import load_path
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

#: Cases of the table: nothing adapted, the payload alone, everything.
CASES: tuple[tuple[str, ...], ...] = ((), ("payload",), KINDS)
PICK_UP_S = 7.0
PAYLOAD_KG = 50.0
#: Held after the path; estimates may still settle in its first second.
HOLD_S = 5.0
SETTLE_S = 1.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """Figures of one run.

    Attributes
    ----------
    rmse_before_mm, max_before_mm, rmse_after_mm, max_after_mm : float
        Tip error from the path's start to the pick-up, and from there to the path's end.
    speed_excess : float
        Largest tip speed over the reference's, less 1.
    payload_before_kg, payload_after_kg : float
        As estimated at the pick-up and at the end; NaN without adaptation.
    coulomb_error, null_error : float
        Largest error of a Coulomb friction (share of the true one) and of a null bias at the end.
    hold_drift : float
        Largest movement of an estimate over the hold, as a share of its bound.
    """

    rmse_before_mm: float
    max_before_mm: float
    rmse_after_mm: float
    max_after_mm: float
    speed_excess: float
    payload_before_kg: float = float("nan")
    payload_after_kg: float = float("nan")
    coulomb_error: float = float("nan")
    null_error: float = float("nan")
    hold_drift: float = float("nan")


def pick_up(
    robot: Robot,
    truth: Truth,
    model: Robot,
    settings: AdaptationSettings,
    payload: Payload,
    *,
    path_name: str = "xs031/parallelogram",
    hold_s: float = HOLD_S,
) -> tuple[Run, Outcome]:
    """Drive one machine along a path, with a payload from an instant on.

    Parameters
    ----------
    robot, truth, model : Robot, Truth, Robot
        Geometry and machine of the rig; what the controller knows.
    settings : AdaptationSettings
    payload : Payload
    path_name : str
    hold_s : float
        Held after the path.

    Returns
    -------
    Run
    Outcome
    """
    path = load_path(path_name)
    start_m = path.sample(0.0)[0].tolist()
    rig = RigCore(robot, truth, tip_m=start_m, payloads=(payload,))
    core = ControllerCore(model, Gains(), path, start_delay_s=START_DELAY_S, adaptation=settings)
    end_s = START_DELAY_S + path.duration_s
    run = run_closed_loop(rig, core, end_s + hold_s)
    before = (run.time_s >= START_DELAY_S) & (run.time_s < payload.from_s)
    after = (run.time_s >= payload.from_s) & (run.time_s < end_s)
    error = 1e3 * np.linalg.norm(run.tip_m - run.tip_reference_m, axis=1)
    tracking = _size(error[before]) + _size(error[after])
    outcome = Outcome(*tracking, _speed_excess(run))
    if not settings.on:
        return run, outcome
    return run, Outcome(
        *tracking,
        outcome.speed_excess,
        *_estimates(run, truth, settings, payload, end_s + SETTLE_S),
    )


def _size(error_mm: FloatArray) -> tuple[float, float]:
    return float(np.sqrt(np.mean(error_mm**2))), float(error_mm.max())


def _speed_excess(run: Run) -> float:
    stamp_ns = np.round(run.time_s * 1e9).astype(np.int64)
    fastest, wanted = (
        float(np.nanmax(speed_m_s(stamp_ns, track, TRUTH_HALF_WIDTH)))
        for track in (run.tip_m, run.tip_reference_m)
    )
    return fastest / wanted - 1.0


def _estimates(
    run: Run, truth: Truth, settings: AdaptationSettings, payload: Payload, held_s: float
) -> tuple[float, float, float, float, float]:
    n = len(truth.cylinders)
    at_pick_up = int(np.searchsorted(run.time_s, payload.from_s))
    last = run.estimates[-1]
    held = run.estimates[run.time_s >= held_s]
    coulomb = np.array([c.coulomb_friction_n for c in truth.cylinders])
    null = np.array([v.null_bias for v in truth.valves])
    bounds = np.array(
        [
            settings.payload_kg,
            *[settings.coulomb_n] * n,
            *[settings.viscous] * n,
            *[settings.null_bias] * n,
        ]
    )
    drift = float(np.max(np.ptp(held, axis=0) / bounds)) if len(held) else float("nan")
    return (
        float(run.estimates[at_pick_up, 0]),
        float(last[0]),
        float(np.max(np.abs(last[1 : n + 1] / coulomb - 1.0))),
        float(np.max(np.abs(last[2 * n + 1 :] - null))),
        drift,
    )


def _row(seed: int, model: str, kinds: tuple[str, ...], o: Outcome) -> str:
    what = " ".join(kinds) or "off"
    tracking = (
        f"{o.rmse_before_mm:.2f} / {o.max_before_mm:.2f} | {o.rmse_after_mm:.2f} /"
        f" {o.max_after_mm:.2f} | {o.speed_excess:+.1%}"
    )
    if not kinds:
        return f"| {seed} | {model} | {what} | {tracking} | | | | |"
    return (
        f"| {seed} | {model} | {what} | {tracking} | {o.payload_before_kg:.1f} ->"
        f" {o.payload_after_kg:.1f} | {o.coulomb_error:.0%} | {o.null_error:.4f} |"
        f" {o.hold_drift:.0e} |"
    )


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="adaptation", description=__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=list(DEFAULT_SEEDS), help="machines"
    )
    parser.add_argument(
        "--models",
        nargs="+",
        default=["exact", "nominal_35bar"],
        help="what the controller knows (default: %(default)s)",
    )
    parser.add_argument("--payload", type=float, default=PAYLOAD_KG, help="kg (%(default)s)")
    parser.add_argument("--at", type=float, default=PICK_UP_S, help="s (%(default)s)")
    options = parser.parse_args(arguments)
    robot, payload = load_robot("xs031"), Payload(options.payload, options.at)
    print("seeds", *options.seeds, f"payload {payload.mass_kg:g} kg from {payload.from_s:g} s")
    print(
        "| seed | model | adapted | before: RMSE / max mm | after: RMSE / max mm | speed excess |"
        " payload kg | Coulomb error | null bias error | drift in hold |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for seed in options.seeds:
        truth = random_truth(robot, seed)
        known = models(robot, truth)
        for name in options.models:
            for kinds in CASES:
                settings = AdaptationSettings(kinds)
                _, outcome = pick_up(robot, truth, known[name], settings, payload)
                print(_row(seed, name, kinds, outcome), flush=True)
    return 0


def main() -> int:
    """Entry point of `python -m hydro_ident.study.adaptation`."""
    return run_command("adaptation", _run)


if __name__ == "__main__":
    sys.exit(main())
