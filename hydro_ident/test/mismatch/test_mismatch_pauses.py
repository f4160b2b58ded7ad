"""Instants at which something may begin lie where there is a recording, not in its pauses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.gaps import find_gaps
from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.forces.force_rows import force_model
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.mismatch.rows.choices import Choices
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.trials.places import ends_of, instant_spacing, instants_of, passages
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.arrays import IntArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
SECONDS, HOUR_S = 20.0, 3600.0


@pytest.fixture(scope="module")
def recording() -> Recording:
    return synthetic_recording(ROBOT, SECONDS, seed=3)


def laid_out(recording: Recording, stamp_ns: IntArray) -> Material:
    gaps = find_gaps(stamp_ns, recording.period_s)
    traces = traces_of([replace(recording, stamp_ns=stamp_ns, gaps=gaps)])
    choices = Choices()
    windows = choices.windows(traces[0].step_s)
    return material_of(ROBOT, force_model(ROBOT), traces, choices.filters, windows, {})


def test_a_recording_without_a_pause_is_covered_evenly(recording: Recording) -> None:
    material = laid_out(recording, recording.stamp_ns)
    end = float(material.time_s.max())
    assert instants_of(material) == pytest.approx(np.linspace(0.0, end, 10)[1:-1].tolist())


def test_none_lies_in_the_pause_between_two_runs(recording: Recording) -> None:
    stamp_ns = recording.stamp_ns.copy()
    half = stamp_ns.size // 2
    stamp_ns[half:] += int(1e9 * HOUR_S)
    material = laid_out(recording, stamp_ns)
    second = HOUR_S + 1e-9 * float(recording.stamp_ns[half] - recording.stamp_ns[0])
    for instants in (instants_of(material), ends_of(material)):
        first = [t for t in instants if t < second - HOUR_S]
        later = [t for t in instants if second <= t <= material.time_s.max()]
        assert sorted(first + later) == instants
        assert abs(len(first) - len(later)) <= 1
    assert instant_spacing(material) < 3.0
    assert max(wide for _, wide, _, _ in passages(material)) < 4.0


def test_a_stamp_of_zero_before_the_clock_is_no_time_that_was_recorded(
    recording: Recording,
) -> None:
    stamp_ns = recording.stamp_ns + 1_700_000_000_000_000_000
    stamp_ns[0] = 0
    instants = instants_of(laid_out(recording, stamp_ns))
    assert len(instants) > 5
    assert np.ptp(instants) < SECONDS
