"""Spikes and dropouts of sensors: found, replaced or left out, and told from motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import Piece
from hydro_ident.estimate.signals.signal_survey import Sensor, SignalSurvey
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.estimate.signals.watched import SPIKE_SIGMAS, watched_sensors
from hydro_ident.identify.estimator_choice import SPIKE_SHARE, worst_sensor
from hydro_ident.identify.identification import identify
from hydro_ident.recordings.cleaning import Cleaner, without_outliers
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.robot import Robot

#: rad, of an encoder of 20 bits.
COUNT = 2.0 * np.pi / 2**20


def test_spikes_are_replaced_and_dropouts_become_gaps() -> None:
    rng = np.random.default_rng(2)
    wave = np.sin(np.linspace(0.0, 20.0, 2000))
    values = wave + 1e-3 * rng.normal(size=2000)
    values[[100, 101, 700]] += 0.5  # the wave itself moves ten deviations per sample
    values[1000:1020] = 0.2
    cleaned, bad = without_outliers(values, 1e-3)
    assert set(np.flatnonzero(bad)) == {100, 101, 700, *range(1000, 1020)}
    assert np.isnan(cleaned[1000:1020]).all()
    assert np.nanmax(np.abs(cleaned - wave)) < 6e-3


def test_only_what_is_gross_is_taken_out_where_little_stands_out(robot: Robot) -> None:
    """A glitch of one sample, and a dropout; smaller spikes and a clean recording stay."""
    good = synthetic_recording(robot, 10.0, 1)
    assert good.p_a is not None
    q, p_a = good.q.copy(), good.p_a.copy()
    q[1200, 0] = 0.0
    q[2500, 1] += 0.02
    p_a[700, 0] = 655.0e5
    p_a[3000:3010, 1] = 0.0
    bad = replace(good, q=q, p_a=p_a)
    counts: list[dict[str, int]] = []
    for recording in (bad, good):
        cleaner = Cleaner.of_gross(robot, SignalSurvey.of(robot, traces_of([recording])))
        counts.append({})
        fresh = cleaner.cleaned(Piece.whole(recording), counts[-1]).recording
    lift, tilt = robot.joint_names[0], robot.cylinders[1].name
    assert counts == [{lift: 1, f"{robot.cylinders[0].name}/a": 1, f"{tilt}/a": 10}, {}]
    np.testing.assert_array_equal(fresh.q, good.q)
    np.testing.assert_array_equal(fresh.p_a, good.p_a)


@pytest.mark.needs("clarabel")
def test_one_gross_sample_does_not_bend_what_is_identified() -> None:
    """Fewer than call for the robust estimator: left out by any other, and said."""
    good = _slide(0.0)
    assert good.effort is not None
    effort, q = good.effort.copy(), good.q.copy()
    effort[9000] = 1.0e6
    q[17_000] = 0.0
    bad = replace(good, effort=effort, q=q)
    told, clean = identify(bad.robot, [bad]), identify(good.robot, [good])
    assert told.estimator is not None
    assert told.estimator.name == "wls"
    assert told.verdict == clean.verdict == "identified"
    said = [note for note in told.notes if "taken for outliers" in note]
    assert [note.split(": ")[1] for note in said] == [
        "1 samples of carriage taken for outliers and left out",
        "1 samples of carriage effort taken for outliers and left out",
    ]
    assert not [note for note in clean.notes if "outliers" in note]
    for a, b in zip(told.parameters, clean.parameters, strict=True):
        assert a.value == pytest.approx(b.value, abs=0.3 * b.std), a.name
        assert a.std == pytest.approx(b.std, rel=0.02), a.name


def test_a_missing_row_or_cycle_leaves_the_others_clean() -> None:
    rng = np.random.default_rng(2)
    wave = np.sin(np.linspace(0.0, 20.0, 2000))
    values = wave + 1e-3 * rng.normal(size=2000)
    spikes = [100, 549, 1399, 1900]
    values[spikes] += 0.5
    values[550] = np.nan
    # The wave jumps across the cycles that are missing behind row 1400.
    values[1400:] += 0.3
    segments = (slice(0, 1400), slice(1400, 2000))
    cleaned, bad = without_outliers(values, 1e-3, segments=segments)
    assert np.flatnonzero(bad).tolist() == spikes
    assert np.flatnonzero(np.isnan(cleaned)).tolist() == [550]
    step = 0.3 * (np.arange(2000) >= 1400)
    assert np.nanmax(np.abs(cleaned - wave - step)) < 2e-2
    assert np.nanmax(np.abs((cleaned - wave - step)[~bad])) < 6e-3


def test_a_lost_row_and_a_gap_do_not_stop_the_cleaner(robot: Robot, with_outliers) -> None:
    bad = with_outliers(synthetic_recording(robot, 30.0, 1), 5, share=0.01, dropouts=0)
    q, stamps = bad.q.copy(), bad.stamp_ns.copy()
    q[5000] = np.nan
    stamps[9000:] += 1_000_000_000
    broken = replace(bad, q=q, stamp_ns=stamps)
    counts: list[dict[str, int]] = []
    for recording in (bad, broken):
        cleaner = Cleaner.of(robot, SignalSurvey.of(robot, traces_of([recording])))
        counts.append({})
        cleaner.cleaned(Piece.whole(recording), counts[-1])
    assert min(counts[0].values()) > 0.008 * len(bad)
    assert set(counts[0]) == set(counts[1])
    for name, count in counts[0].items():
        assert abs(counts[1][name] - count) <= 2, name


def test_rails_are_cleaned_and_their_dropouts_hide_the_valves_alone(robot: Robot) -> None:
    good = synthetic_recording(robot, 5.0, 1)
    assert good.supply is not None
    supply = good.supply + 4.0e3 * np.random.default_rng(1).normal(size=len(good))
    spoilt = supply.copy()
    spoilt[[300, 700]] -= 3.0e6
    spoilt[1000:1025] = 0.0
    bad = replace(good, supply=spoilt)
    signals = SignalSurvey.of(robot, traces_of([bad]))
    assert worst_sensor(robot, signals)[0] == "supply"
    counts: dict[str, int] = {}
    fresh = Cleaner.of(robot, signals).cleaned(Piece.whole(bad), counts).recording
    assert counts == {"supply": 27}
    assert fresh.supply is not None
    assert fresh.valve_v is not None
    assert np.max(np.abs(fresh.supply - supply)) < 3.0e4
    assert np.flatnonzero(np.isnan(fresh.valve_v).any(axis=1)).tolist() == [*range(1000, 1025)]
    assert np.isfinite(fresh.q).all()


#: Mass, viscous and Coulomb friction and offset of a slide.
SLIDE = {
    "carriage_link.mass": 95.0,
    "carriage.viscous_friction": 200.0,
    "carriage.coulomb_friction.force": 20.0,
    "carriage.constant_force_offset.force": -3.0,
}


def _slide(share: float) -> Recording:
    """The shipped slide `emps` on a known motion, its measured drive force with spikes."""
    from hydro_model.robot_files import load_robot

    rng, h = np.random.default_rng(4), 1.0e-3
    time = h * np.arange(30_000)
    waves = [(0.08, 2 * np.pi * 0.2, 0.0), (0.01, 2 * np.pi * 0.9, 1.0), (0.002, 14.0, 2.0)]
    q, qd, qdd = (
        sum(a * w**k * np.sin(w * time + p + 0.5 * np.pi * k) for a, w, p in waves)
        for k in range(3)
    )
    mass, viscous, coulomb, offset = SLIDE.values()
    force = mass * qdd + viscous * qd + coulomb * np.tanh(qd / 1.0e-4) + offset
    force = force + 0.3 * rng.normal(size=time.size)
    force = force + 150.0 * (rng.random(time.size) < share) * rng.choice((-1, 1), time.size)
    robot = load_robot("emps")
    return replace(
        synthetic_recording(load_robot("xs031"), 1.0),
        robot=robot,
        stamp_ns=np.arange(time.size) * 1_000_000,
        period_s=h,
        q=(0.1 + 5e-8 * np.round(q / 5e-8))[:, None],  # type: ignore[operator]
        effort=force[:, None],
        **dict.fromkeys(("p_a", "p_b", "supply", "tank", "valve_v", "command_v", "q_ref")),
        latched=np.zeros(time.size, dtype=bool),
    )


@pytest.mark.needs("clarabel")
def test_spikes_of_a_measured_force_are_seen_and_removed() -> None:
    bad = _slide(0.02)
    auto = identify(bad.robot, [bad])
    assert auto.estimator is not None
    assert auto.estimator.name == "robust"
    assert "carriage effort" in auto.estimator.reason
    assert any("carriage effort taken for outliers" in note for note in auto.notes)
    found = {p.name: p for p in auto.parameters}
    for name, value in SLIDE.items():
        assert abs(found[name].value - value) < 4.0 * found[name].std, name
        assert found[name].value == pytest.approx(value, rel=0.02), name


def test_reversals_of_dry_friction_are_no_spikes_of_a_force() -> None:
    good = _slide(0.0)
    signals = SignalSurvey.of(good.robot, traces_of([good]))
    sensors = {s.name: s for s in watched_sensors(good.robot, signals)}
    assert set(sensors) == {"carriage", "carriage effort"}
    assert all(s.spikes == 0.0 for s in sensors.values())
    # A slide's resolution is what it shows, in metres: no count of a rotary encoder.
    assert sensors["carriage"].noise < 1e-7
    assert sensors["carriage effort"].noise == pytest.approx(0.3, rel=0.1)


def test_a_force_that_is_lost_for_long_is_split_and_loses_no_channel() -> None:
    good = _slide(0.0)
    assert good.effort is not None
    effort = good.effort.copy()
    effort[12_345:12_365] = np.nan
    traces = traces_of([replace(good, effort=effort)])
    assert [t.samples for t in traces] == [12_345, 30_000 - 12_365]
    assert all(np.isfinite(t.joint_torque).all() for t in traces)


def test_a_sensor_at_rest_is_no_dropout() -> None:
    ramp = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 500))
    held = np.concatenate([np.zeros(500), ramp, np.ones(500)])
    assert not without_outliers(held, 1e-4)[1].any()


def test_readings_that_are_held_are_no_dropouts() -> None:
    wave = np.sin(np.linspace(0.0, 200.0, 60_000))
    held = np.repeat(wave[::10], 10)
    cleaned, bad = without_outliers(held, 1e-6)
    assert not bad.any()
    np.testing.assert_array_equal(cleaned, held)
    # A lone one is found in a short stretch, too.
    spoilt = wave[:500].copy()
    spoilt[200:220] = 5.0
    assert np.flatnonzero(without_outliers(spoilt, 1e-3)[1]).tolist() == [*range(200, 220)]


def _ringing(rate_hz: float, mode_hz: float) -> np.ndarray:
    """Joint that velocity steps leave ringing, read by an encoder of 20 bits without noise."""
    random, h = np.random.default_rng(0), 1.0e-3
    asked = 0.1 * np.repeat(random.choice([-1.0, -0.5, 0.0, 0.5, 1.0], 60), 1000)
    stiff, drag = (2.0 * np.pi * mode_hz) ** 2, 2.0 * 0.05 * 2.0 * np.pi * mode_hz
    q = speed = rate = 0.0
    read = np.empty(asked.size)
    for k, wanted in enumerate(asked):
        rate += h * (stiff * (wanted - speed) - drag * rate)
        speed += h * rate
        q += h * speed
        read[k] = COUNT * round(q / COUNT)
    return read[:: round(1.0 / (h * rate_hz))]


@pytest.mark.parametrize(("rate_hz", "mode_hz"), [(50, 1.6), (50, 3.0), (50, 4.4), (100, 4.4)])
def test_an_arm_that_rings_in_a_slow_log_has_no_spikes(rate_hz: float, mode_hz: float) -> None:
    read = _ringing(rate_hz, mode_hz)
    sensor = Sensor()
    sensor.add(read, slice(0, read.size), 1.0 / rate_hz)
    limit = SPIKE_SIGMAS * max(sensor.noise(COUNT), COUNT)
    assert sensor.deviations.share_above(limit) < SPIKE_SHARE
    cleaned, bad = without_outliers(read, COUNT)
    assert bad.sum() <= 1
    assert np.max(np.abs(cleaned - read)) < 0.1e-3


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 500.0])
@pytest.mark.parametrize("size_rad", [2.0e-3, 2.0e-2, 0.5])
def test_lone_spikes_in_a_ringing_arm_are_found_and_filled_in(
    rate_hz: float, size_rad: float
) -> None:
    """Linear interpolation between samples 20 ms apart would miss the mode by milliradians."""
    random, good = np.random.default_rng(5), _ringing(rate_hz, 3.0)
    good = good + COUNT * random.normal(size=good.size)
    bad_at = 40 * random.choice(good.size // 40 - 1, good.size // 250, replace=False) + 20
    read = good.copy()
    read[bad_at] += size_rad * random.choice([-1.0, 1.0], bad_at.size)
    cleaned, bad = without_outliers(read, 1.5 * COUNT)
    assert bad[bad_at].all()
    assert bad.sum() <= 3 * bad_at.size
    assert np.max(np.abs(cleaned - good)) < 1.0e-3
    assert np.median(np.abs(cleaned - good)[bad_at]) < 0.1e-3


def test_a_sensor_of_which_much_stands_out_is_left_as_it_is_and_said(
    robot: Robot, with_outliers
) -> None:
    recording = with_outliers(synthetic_recording(robot, 30.0, 1), 5, share=0.01, dropouts=0)
    q = recording.q.copy()
    at = np.random.default_rng(2).random(len(q)) < 0.07
    q[at, 0] += 0.05
    torn = replace(recording, q=q)
    cleaner = Cleaner.of(robot, SignalSurvey.of(robot, traces_of([torn])))
    [note] = cleaner.notes
    assert f"samples of {robot.joints[0].name} stand out" in note
    counts: dict[str, int] = {}
    fresh = cleaner.cleaned(Piece.whole(torn), counts).recording
    assert robot.joints[0].name not in counts
    assert robot.joints[1].name in counts
    np.testing.assert_array_equal(fresh.q[:, 0], q[:, 0])
