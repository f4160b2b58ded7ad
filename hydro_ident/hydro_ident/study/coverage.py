"""Do nominal 95 % intervals hold where residuals are strongly autocorrelated?

    python -m hydro_ident.study.coverage [--count 200] [--seed 0] [--estimator robust]

Simulated recordings of the crane xs031 on a designed excitation, with residual noise that is
autoregressive, AR(0.98), from row to row of the regression or from sample to sample (500 Hz, then
through the filters). The motion's rows are computed once; every recording has its own noise. Per
parameter: the share of recordings whose interval covers the truth, beside that of the textbook's
iid formula on the same rows, and the median of the interval's width over the iid formula's.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hydro_ident.estimate.flows.chambers import WindowSettings, chambers_of
from hydro_ident.estimate.flows.flow_moments import (
    ChamberMoments,
    FlowGatherer,
    combination,
    gathered_rows,
)
from hydro_ident.estimate.flows.hydraulics import hydraulic_fit
from hydro_ident.estimate.signals.derivatives import FilterSettings, parallel_filter
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.estimate.statistics.least_squares import Estimator, weighted_least_squares
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.parameters.parameters import NORMAL_95, student_95
from hydro_ident.study.designed_motion import DesignedMotion
from hydro_ident.study.synthetic import STEP_S, Noise, synthetic_recording
from hydro_model.command_line.command import Parser, run_command
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

PHI = 0.98
#: Size of the residuals: some hundred newtons, and two per mille of a valve's flow.
FORCE_N, FLOW = (300.0, 500.0), 5.0e-6
DURATIONS_S, KINDS = (30.0, 300.0), ("row", "sample")


@dataclass(frozen=True, slots=True)
class Coverage:
    """Coverage of one parameter's intervals.

    Attributes
    ----------
    name : str
    duration_s : float
    kind : {"row", "sample"}
        From where to where the noise is AR(0.98).
    covered, iid : float
        Shares of the recordings.
    width : float
        Median width over that of the iid formula.
    """

    name: str
    duration_s: float
    kind: str
    covered: float
    iid: float
    width: float


def autoregression(rng: np.random.Generator, count: int, channels: int) -> FloatArray:
    """Stationary AR(0.98) noise of unit variance, (count, channels)."""
    from scipy.signal import lfilter

    white = rng.normal(size=(count + 1000, channels)) * np.sqrt(1.0 - PHI**2)
    return np.asarray(lfilter([1.0], [1.0, -PHI], white, axis=0)[1000:])


@dataclass(frozen=True, slots=True)
class _Outcome:
    """One recording: who covered, and how wide the intervals were."""

    covered: FloatArray
    iid: FloatArray
    width: FloatArray


def force_coverage(
    motion: DesignedMotion, kind: str, count: int, seed: int, estimator: Estimator = "wls"
) -> list[Coverage]:
    """Coverage of the links' and frictions' parameters on a designed motion."""
    settings, model, robot = FilterSettings(), motion.model, motion.model.robot
    rows = motion.rows(settings, estimator == "iv")
    x = rows.x
    friction = [4.0e4] * len(robot.cylinders)
    truth = np.array([*(model.base.combination @ robot.parameter_vector), *friction])

    def once(number: int) -> _Outcome:
        rng = np.random.default_rng([seed, number])
        if kind == "row":
            noise = autoregression(rng, len(x), robot.dof)
        else:
            raw = autoregression(rng, motion.times.size, robot.dof)
            noise = parallel_filter(raw, STEP_S, settings)
        y = x @ truth + noise * np.array(FORCE_N)
        fit = weighted_least_squares([replace(rows, y=y)], estimator)
        theta, std = _iid(x, y)
        half = np.array([student_95(d) for d in fit.dof]) * fit.std
        return _Outcome(
            np.abs(fit.theta - truth) < half,
            np.abs(theta - truth) < NORMAL_95 * std,
            half / (NORMAL_95 * std),
        )

    return _summary(model.names, [once(i) for i in range(count)], motion.duration_s, kind)


def flow_coverage(
    robot: Robot, duration_s: float, kind: str, count: int, seed: int
) -> list[Coverage]:
    """Coverage of bulk moduli, valve edges and delay on a driven run, repeated to length."""
    windows, delay_s = WindowSettings(), 0.0007
    run = synthetic_recording(robot, DURATIONS_S[0], noise=Noise(0.0, 0.0))
    trace = traces_of([replace(run, path=Path("run"))])[0]
    combine = combination(delay_s / STEP_S, 0, windows)[0]
    gathered, exact = {}, {}
    for chamber in chambers_of(robot):
        rows = gathered_rows(chamber, trace, windows)
        inverse = 1.0 / chamber.cylinder.bulk_modulus_pa
        edges = [float(getattr(chamber.valve, edge)) for edge in chamber.edges]
        laps = round(duration_s / DURATIONS_S[0])
        long = np.tile(rows.x, (laps, 1, 1))
        time_s = rows.step_s * np.arange(float(len(long)))
        gathered[chamber.channel] = replace(rows, x=long, y=long[:, :, 0], time_s=time_s)
        exact[chamber.channel] = long @ combine @ np.array([inverse, *edges])
    span = round(windows.length_s / STEP_S)
    hop = round(windows.hop_s / STEP_S)

    def once(number: int) -> tuple[tuple[str, ...], _Outcome]:
        rng = np.random.default_rng([seed, number])
        gatherer = FlowGatherer(robot, "run", windows)
        plain = {}
        for name, rows in gathered.items():
            size = len(rows.time_s)
            if kind == "row":
                noise = autoregression(rng, size, 1)
            else:
                total = np.cumsum(autoregression(rng, size * hop + span, 1), axis=0)
                noise = ((total[span:] - total[:-span]) / span)[: size * hop : hop]
            fresh = replace(rows, y=exact[name] + FLOW * noise)
            moments = Moments.like(fresh, "run")
            moments.add(fresh)
            gatherer.chambers[name] = ChamberMoments((), moments, STEP_S, windows)
            plain[name] = _iid(fresh.x @ combine, fresh.y)
        return _flow_outcome(robot, gatherer, plain, delay_s)

    results = [once(i) for i in range(count)]
    return _summary(results[0][0], [outcome for _, outcome in results], duration_s, kind)


def _flow_outcome(
    robot: Robot,
    gatherer: FlowGatherer,
    plain: dict[str, tuple[FloatArray, FloatArray]],
    delay_s: float,
) -> tuple[tuple[str, ...], _Outcome]:
    fit = hydraulic_fit(robot, [gatherer], WindowSettings())
    if fit is None:
        raise ValueError("no chamber was fitted")
    names, covered, iid, width = [], [], [], []
    for cylinder in fit.cylinders:
        for i, name in enumerate(cylinder.names):
            value, std = cylinder.value(name)
            half = student_95(float(cylinder.dof[i])) * std
            # The iid formula of the chamber that has this column; of the first where both have.
            chamber = next(c for c in cylinder.chambers if name in c.names)
            at = chamber.names.index(name)
            theta, error = (v[at] for v in plain[chamber.chamber.channel])
            truth = _truth(robot, chamber.chamber.cylinder.name, name)
            names.append(f"{cylinder.cylinder}.{name}")
            covered.append(abs(value - truth) < half)
            iid.append(abs(theta - truth) < NORMAL_95 * error)
            width.append(half / (NORMAL_95 * error))
    half = student_95(fit.delay_dof) * fit.delay_std_s
    names.append("command_delay")
    covered.append(abs(fit.delay_s - delay_s) < half)
    iid.append(np.nan)
    width.append(np.nan)
    columns = [np.array(c, dtype=float) for c in (covered, iid, width)]
    return tuple(names), _Outcome(*columns)


def _truth(robot: Robot, cylinder: str, name: str) -> float:
    if name.startswith("c_"):
        return float(getattr(robot.valve_of(cylinder), name))
    return 1.0 / robot.cylinder(cylinder).bulk_modulus_pa


def _iid(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares weighted by each channel's residual, with the textbook's deviations."""
    weight = np.ones(y.shape[1])
    size = x.shape[2]
    theta, inverse = np.zeros(size), np.eye(size)
    for _ in range(3):
        stacked, level = (x * weight[:, None]).reshape(-1, size), (y * weight).ravel()
        norms = np.linalg.norm(stacked, axis=0)
        inverse = np.linalg.pinv(stacked / norms) / norms[:, None]
        theta = inverse @ level
        weight = 1.0 / np.std(y - x @ theta, axis=0)
    return theta, np.sqrt(np.sum(inverse**2, axis=1))


def _summary(
    names: Sequence[str], outcomes: Sequence[_Outcome], duration_s: float, kind: str
) -> list[Coverage]:
    covered, iid = (
        np.mean([getattr(o, field) for o in outcomes], axis=0) for field in ("covered", "iid")
    )
    width = np.median([o.width for o in outcomes], axis=0)
    return [
        Coverage(name, duration_s, kind, float(covered[i]), float(iid[i]), float(width[i]))
        for i, name in enumerate(names)
    ]


def study(count: int, seed: int, estimator: Estimator | None = None) -> list[Coverage]:
    """Every parameter, duration and kind of noise; by an `estimator` the forces' alone."""
    robot = load_robot("xs031")
    found: list[Coverage] = []
    if estimator is not None:
        motion = DesignedMotion.of(robot, DURATIONS_S[0])
        return [c for k in KINDS for c in force_coverage(motion, k, count, seed, estimator)]
    for duration_s in DURATIONS_S:
        motion = DesignedMotion.of(robot, duration_s)
        for kind in KINDS:
            found += force_coverage(motion, kind, count, seed)
            found += flow_coverage(robot, duration_s, kind, count, seed)
    return found


def table(found: Sequence[Coverage]) -> str:
    """The study as a table of Markdown."""
    cases = list(dict.fromkeys((c.duration_s, c.kind) for c in found))
    lines = [
        "| Parameter | " + " | ".join(f"{d:g} s, {kind}" for d, kind in cases) + " |",
        "|---|" + "---|" * len(cases),
    ]
    for name in dict.fromkeys(c.name for c in found):
        cells = []
        for case in cases:
            one = next(c for c in found if c.name == name and (c.duration_s, c.kind) == case)
            iid = "" if np.isnan(one.iid) else f" ({100 * one.iid:.0f}, x{one.width:.1f})"
            cells.append(f"{100 * one.covered:.1f}{iid}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="coverage", description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="recordings per case")
    parser.add_argument("--seed", type=int, default=0, help="which recordings (%(default)s)")
    parser.add_argument(
        "--estimator",
        choices=("robust", "iv"),
        help="of the forces alone, on the shortest recordings",
    )
    options = parser.parse_args(arguments)
    found = study(options.count, options.seed, options.estimator)
    shares = [c.covered for c in found]
    print("% covered (of the iid formula, factor of the width)")
    print(table(found))
    print(
        f"from {100 * min(shares):.1f} to {100 * max(shares):.1f} % of {options.count} recordings"
    )
    return 0


def main() -> int:
    """Entry point of `python -m hydro_ident.study.coverage`."""
    return run_command("coverage", _run)


if __name__ == "__main__":
    sys.exit(main())
