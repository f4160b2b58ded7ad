"""Interpolated recordings are seen, said and thinned; others stay as they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.changes import Changes
from hydro_ident.bag.reading_rate import look_twice
from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import map_columns
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import traces_of_piece
from hydro_ident.identify.identification import identify
from hydro_ident.inspecting.health import find_irregularities
from hydro_ident.mismatch.rows.choices import Choices, choices_of
from hydro_ident.mismatch.split.residuals import own_forces
from hydro_ident.recordings.sources import MemorySource
from hydro_model.robot_files import load_robot

RATE_HZ, SECONDS, EVERY = 1000.0, 20.0, 16


def recording(noise_rad: float, every: int = 1, quantum_rad: float = 0.0) -> Recording:
    """A slow motion of the reference crane, read every so many cycles and interpolated."""
    robot, random = load_robot("xs031"), np.random.default_rng(7)
    time = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    taken = time[::every]

    def column(values: np.ndarray, noise: float) -> np.ndarray:
        return np.interp(time, taken, values + noise * random.standard_normal(taken.size))

    q = np.stack(
        [column(0.6 + 0.3 * np.sin(0.6 * taken), noise_rad),
         column(-1.2 + 0.3 * np.sin(0.4 * taken), noise_rad)], axis=1
    )  # fmt: skip
    if quantum_rad:
        q = quantum_rad * np.round(q / quantum_rad)
    waves = [column(5e6 + 1e5 * np.sin(taken + k), 4e3) for k in range(4)]
    pressures = np.stack(waves, axis=1)
    none = dict.fromkeys(
        ("stroke", "effort", "supply", "tank", "valve_v", "command_v", "spool", "q_ref", "qd_ref",
         "force_ref", "tip_ref", "temperature_stamp_ns", "temperature_c")
    )  # fmt: skip
    return Recording(
        path=Path("bag"), robot=robot, stamp_ns=np.round(time * 1e9).astype(np.int64),
        period_s=1.0 / RATE_HZ, q=q, p_a=pressures[:, :2], p_b=pressures[:, 2:],
        valve_source="", latched=np.zeros(time.size, dtype=bool), losses=(), gaps=(),
        duplicates={}, notes=(), metadata={}, **none,
    )  # fmt: skip


def test_an_interpolated_recording_is_thinned_and_said() -> None:
    read = recording(1e-3, EVERY)
    assert look_twice(read).every() == EVERY
    piece = next(MemorySource(read).pieces())
    assert piece.recording.period_s == pytest.approx(EVERY / RATE_HZ)
    assert len(piece.recording) == pytest.approx(len(read) / EVERY, abs=1)
    assert any("62.5 readings per second" in note for note in piece.recording.notes)
    assert [f.kind for f in find_irregularities(read)] == ["interpolated"]


@pytest.mark.parametrize(("noise", "quantum"), [(1e-5, 0.0), (0.0, 0.0), (0.0, 6e-6), (0.0, 1e-3)])
def test_noisy_smooth_and_quantised_signals_are_not_taken_for_interpolated(
    noise: float, quantum: float
) -> None:
    assert look_twice(recording(noise, 1, quantum)).every() == 1


def test_one_sensor_at_its_full_rate_is_enough() -> None:
    read = recording(1e-3, EVERY)
    p_a = read.p_a.copy()
    p_a[:, 0] += 4e3 * np.random.default_rng(1).standard_normal(len(read))
    assert look_twice(replace(read, p_a=p_a)).every() == 1


def held(read: Recording, every: int, slips: bool = False) -> Recording:
    """As a bus delivers it that is slower than the log: each reading until the next one."""
    count = len(read)
    steps = np.full(count, every)
    if slips:
        steps += np.random.default_rng(3).integers(-1, 2, count)
    taken = np.concatenate([[0], np.cumsum(steps)])
    at = taken[np.searchsorted(taken, np.arange(count), side="right") - 1]
    return map_columns(read, lambda v: v if v.dtype == np.int64 else v[at])


@pytest.mark.parametrize("slips", [False, True])
def test_readings_that_are_held_are_thinned_and_said(slips: bool) -> None:
    read = held(recording(1e-5), 10, slips)
    assert look_twice(read).every() == 10
    piece = next(MemorySource(read).pieces())
    assert len(piece.recording) == pytest.approx(len(read) / 10, abs=1)
    [note] = piece.recording.notes
    assert "stand still over 10 samples at a time: about 100 readings per second" in note
    assert [f.text for f in find_irregularities(read)] == [note.split("; one sample")[0]]


def test_coarse_readings_that_are_held_are_thinned() -> None:
    assert look_twice(held(recording(0.0, 1, 1e-3), 10)).every() == 10


@pytest.mark.parametrize("quantum", [3e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_coarse_encoder_alone_is_not_taken_for_one_that_is_held(
    noise: float, quantum: float
) -> None:
    """It repeats itself as long as its joint takes for a count: now three samples, now forty."""
    read = recording(noise, 1, quantum)
    assert look_twice(replace(read, p_a=None, p_b=None)).every() == 1
    # Even at a constant speed: it never passes over a count.
    ramp = 2e-4 * np.arange(len(read))[:, None] * np.ones(2)
    even = quantum * np.floor(ramp / quantum + 1e-9)
    assert look_twice(replace(read, q=even, p_a=None, p_b=None)).every() == 1


def test_held_pressures_beside_quick_positions_are_not_thinned() -> None:
    quick, slow = recording(1e-5), held(recording(1e-5), 10)
    assert look_twice(replace(slow, q=quick.q)).every() == 1


@pytest.mark.parametrize(("every", "slips"), [(2, False), (5, False), (10, True)])
def test_pressures_that_are_held_are_led_from_reading_to_reading(every: int, slips: bool) -> None:
    """Held they are late by half of that on average, and step."""
    quick, true = recording(1e-5), recording(1e-5)
    time = np.arange(len(quick)) / RATE_HZ
    waves = 5e6 + 1e6 * np.sin(4.0 * time[:, None] + np.arange(4.0))
    true = replace(quick, p_a=waves[:, :2], p_b=waves[:, 2:])
    read = replace(held(true, every, slips), q=quick.q)
    led = next(MemorySource(read).pieces()).recording
    np.testing.assert_array_equal(led.q, quick.q)
    for name in ("p_a", "p_b"):
        off = getattr(led, name) - getattr(true, name)
        known = np.isfinite(off)
        assert known.mean() > 0.998
        # A step of a held one is 40 kPa at most.
        assert np.abs(off[known]).max() < 20.0
        assert np.abs(getattr(read, name) - getattr(true, name)).max() > 3e3
    assert led.read_s == pytest.approx(every / RATE_HZ)
    [note] = led.notes
    assert f"its pressures stand still over {every} samples at a time" in note
    assert [(f.signal, f.kind) for f in find_irregularities(read)] == [("pressures", "held")]


def test_a_held_pressure_at_rest_stays_at_rest_until_it_moves() -> None:
    quick = recording(1e-5)
    time = np.arange(len(quick)) / RATE_HZ
    moved = 1e5 * np.sin(4.0 * time) + 2e6 * np.clip(time - 10.0, 0.0, 1.0)
    moved[(time >= 5.0) & (time < 10.0)] = moved[5000]
    read = replace(quick, p_a=np.stack([moved] * 2, 1), p_b=np.stack([moved] * 2, 1))
    led = next(MemorySource(replace(held(read, 5), q=quick.q)).pieces()).recording
    assert led.p_a is not None
    np.testing.assert_allclose(led.p_a[5010:9990], moved[5000])


def test_a_reading_that_is_missing_in_a_held_message_is_not_made_up() -> None:
    quick, slow = recording(1e-5), held(recording(1e-5), 5)
    assert slow.p_a is not None
    p_a = slow.p_a.copy()
    p_a[7000:7400, 1] = np.nan
    led = next(MemorySource(replace(slow, q=quick.q, p_a=p_a)).pieces()).recording
    assert led.p_a is not None
    assert np.isnan(led.p_a[7000:7400, 1]).all()
    assert np.isfinite(led.p_a[7000:7400, 0]).all()


@pytest.mark.needs("clarabel")
def test_oil_is_as_stiff_by_pressures_of_a_slower_bus(crane_run: Any) -> None:
    """Held over 10 ms it was 3 % too soft, 15 standard deviations, without a word."""
    whole = crane_run.recording()
    at = np.arange(len(whole)) // 5 * 5
    read = replace(whole, p_a=whole.p_a[at], p_b=whole.p_b[at])
    found = {p.name: p for p in identify(whole.robot, [read]).parameters}
    for cylinder in crane_run.robot.cylinders:
        bulk = found[f"{cylinder.name}.bulk_modulus"]
        assert bulk.value == pytest.approx(cylinder.bulk_modulus_pa, abs=3.0 * bulk.std)
        assert bulk.std < 5e-3 * bulk.value
    delay = found["command_delay"]
    assert delay.value == pytest.approx(crane_run.robot.command_delay_s, abs=2.0 * delay.std)


def choices(read: Recording) -> Choices:
    traces = [t for piece in MemorySource(read).pieces() for t in traces_of_piece(piece)]
    signals = SignalSurvey.of(read.robot, traces)
    return choices_of(own_forces(read.robot, torque=False), signals, traces)


def test_quiet_positions_keep_the_usual_filters() -> None:
    assert choices(recording(4e-6)) == Choices()


def test_filters_are_those_that_recordings_to_verify_on_bear_too() -> None:
    """One of 50 Hz knows nothing of 25 Hz."""
    read = recording(4e-6)
    (quick,) = [t for piece in MemorySource(read).pieces() for t in traces_of_piece(piece)]
    slow = replace(quick, step_s=0.02)
    signals = SignalSurvey.of(read.robot, [quick])
    forces = own_forces(read.robot, torque=False)
    assert choices_of(forces, signals, [quick]).filters.differentiation_hz == 25.0
    assert choices_of(forces, signals, [quick], [slow]).filters.differentiation_hz <= 20.0


def test_no_choice_depends_on_the_order_of_recordings() -> None:
    """Their intervals are means of stamps, and differ in the ninth digit."""
    read = recording(4e-6)
    (trace,) = [t for piece in MemorySource(read).pieces() for t in traces_of_piece(piece)]
    random = np.random.default_rng(1).normal(size=trace.valve_signal.shape)
    waves = np.sin(trace.time_s)[:, None] * np.ones(2)
    calm = replace(trace, valve_signal=waves)
    lively = replace(trace, valve_signal=random, step_s=trace.step_s * (1.0 + 1e-9))
    signals = SignalSurvey.of(read.robot, [trace])
    forces = own_forces(read.robot, torque=False)
    one, other = (choices_of(forces, signals, both) for both in ([lively, calm], [calm, lively]))
    assert one.windows_s == pytest.approx(other.windows_s, rel=1e-6)
    alone = choices_of(forces, signals, [calm])
    assert alone.windows_s[0] > 1.1 * one.windows_s[0]


def test_noisy_positions_are_looked_at_slowly() -> None:
    slow, usual = choices(recording(2e-3)), Choices()
    assert slow.filters.parallel_hz < usual.filters.parallel_hz
    assert slow.windows_s[0] > usual.windows_s[0]
    assert slow.rest_speed is not None
    assert "noisy beside its motion" in slow.notes[0]
    slower = choices(recording(8e-3))
    assert slower.filters.differentiation_hz < slow.filters.differentiation_hz


def test_changes_are_the_same_where_a_column_is_missing_in_some_stretches() -> None:
    values = np.random.default_rng(5).integers(0, 3, (90, 4)).astype(float)
    values[:, 0], values[30:60, 1], values[:60, 2], values[40:, 3] = (np.nan,) * 4
    whole, cut = Changes(4), Changes(4)
    whole.add(values)
    for begin in range(0, 90, 10):
        cut.add(values[begin : begin + 10])
    # What every column is counted for is as of steps from row to row.
    steps = np.diff(values, axis=0)
    for one in (whole, cut):
        np.testing.assert_array_equal(one.changes, (steps != 0.0).sum(axis=0))
        np.testing.assert_array_equal(one.moving, [1, 2, 3])
        np.testing.assert_array_equal(one.smallest, [np.nan, 1.0, 1.0, 1.0])
        assert [b.met for b in one.bends] == [0, 60, 30, 40]
    assert [b.rms for b in cut.bends] == [b.rms for b in whole.bends]
