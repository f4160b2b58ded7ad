"""What repeats over time: in every recording at a phase of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.locating.periodic import Lines
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.mismatch.unnamed.describe import form_of
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_ident.recordings.sources import sources_of
from hydro_ident.report.diagnosis_views import _dependence_view
from hydro_model.robot_files import load_robot

STEP_S, HUM_HZ = 0.02, 4.1


def _lines(
    lengths_s: Sequence[float], seed: int, *, red: float = 0.0, hum: Sequence[float] = ()
) -> Lines:
    """Bags of noise, each on its own time axis, with a hum at some phases in them."""
    rng = np.random.default_rng(seed)
    times = [np.arange(0.0, length, STEP_S) for length in lengths_s]
    noise = [rng.standard_normal(t.size) for t in times]
    rows = [lfilter([np.sqrt(1.0 - red**2)], [1.0, -red], e) for e in noise]
    for row, t, phase in zip(rows, times, hum, strict=False):
        row += 0.12 * np.cos(2.0 * np.pi * HUM_HZ * t + phase)
    recording = np.repeat(np.arange(len(times)), [t.size for t in times])
    time, linked = np.concatenate(times), np.diff(recording, prepend=-1) == 0
    layout = Layout(np.zeros(time.size, dtype=np.intp), recording, time, linked)
    white = Noise((np.zeros(0),), np.ones(1))
    bench = Bench(layout, white, np.concatenate(rows), np.ones((time.size, 1)), 1.0)
    lines = Lines.of(bench, time, np.ones(time.size), recording)
    assert lines is not None
    return lines


def _chance(lines: Lines) -> tuple[float, float]:
    """The least p-value, and its wave number."""
    found = []
    for k in lines.strongest():
        turns = 2.0 * np.pi * lines.numbers[k] * lines.at
        waves = np.stack([f(turns) * g for g in lines.apart for f in (np.cos, np.sin)], axis=1)
        white = lines.bench.beyond(waves)
        theta = np.linalg.lstsq(white, lines.bench.residual, rcond=None)[0]
        p = lines.p_value(k, lines.bench.residual - white @ theta)
        found.append((p, float(lines.numbers[k])))
    return min(found)


@pytest.mark.parametrize("phases", [(0.3,) * 2, (0.0, np.pi), (0.2, 4.1, 2.2, 5.7, 1.1, 3.3)])
def test_more_recordings_show_a_hum_better_whatever_its_phase(phases: tuple[float, ...]) -> None:
    alone = _chance(_lines([60.0], 5, hum=phases[:1]))[0]
    p, number = _chance(_lines([60.0] * len(phases), 5, hum=phases))
    assert p < 1e-2 * alone
    assert number == pytest.approx(HUM_HZ, abs=1.0 / 60.0)


@pytest.mark.parametrize("red", [0.0, 0.9])
@pytest.mark.parametrize("lengths_s", [[40.0], [40.0, 40.0], [40.0, 10.0, 5.0], [20.0] * 6])
def test_noise_has_no_lines(lengths_s: list[float], red: float) -> None:
    chances = [_chance(_lines(lengths_s, seed, red=red))[0] for seed in range(20)]
    assert min(chances) > 1e-3
    # Twice in twenty would be chance; seven times in twenty once in 10 000.
    assert sum(p <= 0.1 for p in chances) <= 6


def _hum(crane_run: Any, force_n: float) -> Recording:
    """Something pushes a piston to and fro at 4 Hz."""
    p_a = crane_run.p_a.copy()
    time = np.arange(len(p_a)) * 0.002
    area = crane_run.robot.cylinders[0].area_a_m2
    p_a[:, 0] += force_n * np.sin(2.0 * np.pi * 4.0 * time) / area
    run: Recording = replace(crane_run, p_a=p_a).recording(f"push {force_n}")
    return run


@pytest.fixture(scope="module")
def humming(crane_run: Any) -> Residuals:
    """Two recordings of one machine, in which it hums against each other."""
    robot = load_robot("xs031")
    sources = sources_of([_hum(crane_run, 400.0), _hum(crane_run, -400.0)])
    surveys = [survey_source(source, robot) for source in sources]
    work = residuals(robot, sources, [], surveys, DiagnosisSettings())
    assert work is not None
    return work


@pytest.fixture(scope="module")
def hum(humming: Residuals) -> Dependence:
    """What is found of it in the force."""
    channel = humming.training.predictor.material.channels.index("lift/force")
    found = dependences(humming.training, humming.base)
    return next(
        d
        for d in found
        if (d.channel, d.variable, d.times) == (channel, "time", "") and 0.2 < d.period < 0.3
    )


def test_a_hum_is_found_at_its_size_in_recordings_against_each_other(hum: Dependence) -> None:
    assert hum.p_value < 1e-6
    assert hum.period == pytest.approx(0.25, rel=0.005)
    assert float(np.hypot(*hum.coefficients)) == pytest.approx(400.0, rel=0.1)
    assert hum.share > 0.5
    # Half a period lies between the two.
    apart = float(hum.lags[1] - hum.lags[0]) / hum.period
    assert abs(apart) == pytest.approx(0.5, abs=0.02)


def test_its_law_is_drawn_and_told_of_both(humming: Residuals, hum: Dependence) -> None:
    view = _dependence_view(humming.training, humming.base, hum, "")
    assert float(np.std(view.left)) < 0.5 * float(np.std(view.residual))
    confirmer = Confirmer(humming.training, humming.check, humming.base)
    form = form_of(humming.training, humming.base, confirmer, hum)
    assert form is not None
    told = {value.name: value.value for value in form.values}
    assert told["amplitude"] == pytest.approx(400.0, rel=0.1)
    assert told["period"] == pytest.approx(0.25, rel=0.001)
