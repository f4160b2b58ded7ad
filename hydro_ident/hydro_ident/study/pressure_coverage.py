"""Do intervals of bulk moduli, edges and delay hold where the pressures are noisy or rounded?

    python -m hydro_ident.study.pressure_coverage [--count 40] [--seed 0]

Recordings of the crane xs031 in closed loop, 40 s each, at the pace of `synthetic.references` and
at a fourth of it, where pressures hardly move. Every recording has its own noise of the
transducers: white, rounded to 12 bits over 400 bar, both, or white noise behind a filter. Per
case: the share of intervals that hold the truth, and by how much bulk moduli are off in the mean.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.flows.chambers import INVERSE_BULK, WindowSettings
from hydro_ident.estimate.flows.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.parameters.parameters import student_95
from hydro_ident.study.synthetic import STEP_S, Noise, synthetic_recording
from hydro_model.command_line.command import Parser, run_command
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

DURATION_S, PACES = 40.0, (1.0, 0.25)
#: A step of 12 bits over 400 bar, Pa.
STEP_PA = 400.0e5 / 4096.0
#: Commands take this many cycles.
_LATE = 1

Readings = Callable[[np.random.Generator, FloatArray], FloatArray]


def white(size_pa: float) -> Readings:
    """Noise of a deviation of `size_pa`, independent from sample to sample."""
    return lambda rng, p: p + size_pa * rng.normal(size=p.shape)


def rounded(size_pa: float) -> Readings:
    """Noise of a deviation of `size_pa`, then rounding to 12 bits."""
    return lambda rng, p: STEP_PA * np.round(white(size_pa)(rng, p) / STEP_PA)


def filtered(size_pa: float, corner_hz: float) -> Readings:
    """Noise of a deviation of `size_pa` behind a low-pass of first order at `corner_hz`."""
    from scipy.signal import lfilter

    keep = float(np.exp(-2.0 * np.pi * corner_hz * STEP_S))

    def read(rng: np.random.Generator, p: FloatArray) -> FloatArray:
        raw = size_pa * np.sqrt(1.0 - keep**2) * rng.normal(size=p.shape)
        return np.asarray(p + lfilter([1.0], [1.0, -keep], raw, axis=0))

    return read


KINDS: dict[str, Readings] = {
    "2 kPa": white(2.0e3),
    "20 kPa": white(20.0e3),
    "12 bits": rounded(0.0),
    "12 bits, 5 kPa": rounded(5.0e3),
    "20 kPa, filtered at 80 Hz": filtered(20.0e3, 80.0),
}


@dataclass(frozen=True, slots=True)
class PressureCase:
    """One kind of readings at one pace.

    Attributes
    ----------
    kind : str
    pace : float
    bulk, edges, delay : float
        Shares of intervals that hold the truth.
    off : float
        Mean of fitted over true modulus, less 1; of the modulus that is furthest off.
    refused : int
        Moduli that were not stated.
    """

    kind: str
    pace: float
    bulk: float
    edges: float
    delay: float
    off: float
    refused: int


def recorded(robot: Robot, pace: float, duration_s: float = DURATION_S) -> Recording:
    """A recording with exact pressures, whose commands act one cycle late.

    Parameters
    ----------
    robot : Robot
    pace : float
    duration_s : float
    """
    run = synthetic_recording(robot, duration_s, noise=Noise(pressure_pa=0.0), pace=pace)
    assert run.valve_v is not None
    early = np.concatenate([run.valve_v[_LATE:], run.valve_v[-_LATE:]])
    return replace(run, valve_v=early, command_v=early)


def read(run: Recording, kind: str, seed: int) -> Recording:
    """The recording as transducers of a kind read it.

    Parameters
    ----------
    run : Recording
    kind : str
        Of `KINDS`.
    seed : int
    """
    rng, readings = np.random.default_rng(seed), KINDS[kind]
    assert run.p_a is not None
    assert run.p_b is not None
    return replace(run, p_a=readings(rng, run.p_a), p_b=readings(rng, run.p_b))


def fitted(run: Recording) -> HydraulicFit:
    """Chambers and delay of a recording."""
    fit = fit_hydraulics(run.robot, traces_of([run]), WindowSettings(max_delay_cycles=2.0))
    assert fit is not None
    return fit


def pressure_case(run: Recording, kind: str, pace: float, count: int, seed: int) -> PressureCase:
    """Coverage over recordings with noise of their own.

    Parameters
    ----------
    run : Recording
        With exact pressures.
    kind : str
    pace : float
    count, seed : int
    """
    held: dict[str, list[bool]] = {"bulk": [], "edges": [], "delay": []}
    off: dict[str, list[float]] = {}
    refused = 0
    for number in range(count):
        fit = fitted(read(run, kind, seed + number))
        half = student_95(fit.delay_dof) * fit.delay_std_s
        held["delay"].append(abs(fit.delay_s - _LATE * STEP_S) < half)
        for cylinder in fit.cylinders:
            valve = run.robot.valve_of(cylinder.cylinder)
            refused += cylinder.refused_bulk is not None
            for at, name in enumerate(cylinder.names):
                value, std = cylinder.value(name)
                is_bulk = name == INVERSE_BULK
                if is_bulk and cylinder.refused_bulk is not None:
                    value, std = cylinder.refused_bulk.inverse, cylinder.refused_bulk.std
                modulus = run.robot.cylinder(cylinder.cylinder).bulk_modulus_pa
                truth = 1.0 / modulus if is_bulk else float(getattr(valve, name))
                half = student_95(float(cylinder.dof[at])) * std
                held["bulk" if is_bulk else "edges"].append(abs(value - truth) < half)
                if is_bulk:
                    off.setdefault(cylinder.cylinder, []).append(truth / value - 1.0)
    furthest = max((float(np.mean(some)) for some in off.values()), key=abs)
    shares = {name: float(np.mean(some)) for name, some in held.items()}
    return PressureCase(kind, pace, **shares, off=furthest, refused=refused)


def table(cases: Sequence[PressureCase]) -> str:
    """The study as a table of Markdown."""
    lines = [
        "| Readings | Pace | Moduli, % | Edges, % | Delay, % | Moduli off, mean, % | Refused |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {c.kind} | {c.pace:g} | {100 * c.bulk:.0f} | {100 * c.edges:.0f} |"
        f" {100 * c.delay:.0f} | {100 * c.off:+.2f} | {c.refused} |"
        for c in cases
    ]
    return "\n".join(lines)


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="pressure_coverage", description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="recordings per case")
    parser.add_argument("--seed", type=int, default=0, help="which recordings (%(default)s)")
    options = parser.parse_args(arguments)
    found = []
    for pace in PACES:
        run = recorded(load_robot("xs031"), pace)
        found += [pressure_case(run, kind, pace, options.count, options.seed) for kind in KINDS]
    print(table(found))
    return 0


def main() -> int:
    """Entry point of `python -m hydro_ident.study.pressure_coverage`."""
    return run_command("pressure_coverage", _run)


if __name__ == "__main__":
    sys.exit(main())
