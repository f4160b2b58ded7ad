"""What is known of the sensors' noise before anything is fitted."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings, chambers_of
from hydro_ident.estimate.forces.inertial import force_model
from hydro_ident.estimate.forces.standstill import still_joints
from hydro_ident.estimate.scoring.noise import encoder_noise, flow_noise, force_noise
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.signal_survey import Sensor, SignalSurvey
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.mismatch.modelling.shots import sensor_noise
from hydro_model.robot import Robot

STEP_M = 1.0e-4


def _telescope(robot: Robot, counts: int) -> Robot:
    """The crane with a slide for its second joint, and encoders of so many counts."""
    joints = (robot.joints[0], replace(robot.joints[1], prismatic=True))
    return replace(
        robot, joints=joints, sensors=replace(robot.sensors, encoder_counts_per_rev=counts)
    )


def _seen(robot: Robot, crane_run: Any) -> SignalSurvey:
    """The run, its slide going 50 mm and read to a tenth of a millimetre."""
    slide = np.linspace(0.0, 1.0, len(crane_run.q)) ** 2
    q = np.stack([crane_run.q[:, 0], np.round(0.05 * slide / STEP_M) * STEP_M], axis=1)
    return SignalSurvey.of(robot, traces_of([crane_run.recording(q=q)]))


def test_counts_per_revolution_are_no_resolution_of_a_slide(robot: Robot, crane_run: Any) -> None:
    """12 bits are 1.5 mrad of a turn; of a slide's metres they say nothing."""
    coarse, fine = (_telescope(robot, counts) for counts in (4096, 1048576))
    noise = [encoder_noise(_seen(one, crane_run)) for one in (coarse, fine)]
    assert noise[0][0] == pytest.approx(2.0 * math.pi / 4096 / math.sqrt(12.0), rel=0.01)
    assert noise[1][0] < 0.1 * noise[0][0]
    assert noise[0][1] == noise[1][1]
    assert noise[0][1] == pytest.approx(STEP_M / math.sqrt(12.0), rel=1e-9)
    for one, expected in zip((coarse, fine), noise, strict=True):
        survey = _seen(one, crane_run)
        assert sensor_noise(one, survey)[:2] == pytest.approx(expected)
        assert still_joints(one, survey) == ()


def test_angles_rounded_behind_a_fine_encoder_are_as_coarse_as_they_were_written(
    robot: Robot, crane_run: Any
) -> None:
    """To a milliradian, while the joints rest for most of the time."""
    rests = np.repeat(crane_run.q[:1], 3 * len(crane_run.q), axis=0)
    q = np.round(np.concatenate([crane_run.q, rests]) / 1e-3) * 1e-3
    count = len(q)
    columns = {
        name: np.resize(values, (count, *values.shape[1:]))
        for name in ("p_a", "p_b", "supply", "tank", "valve_v", "latched")
        if (values := getattr(crane_run.recording(), name)) is not None
    }
    stamps = crane_run.recording().stamp_ns[0] + 2_000_000 * np.arange(count)
    recording = crane_run.recording(q=q, stamp_ns=stamps, command_v=None, **columns)
    survey = SignalSurvey.of(robot, traces_of([recording]))
    assert encoder_noise(survey) == pytest.approx(1e-3 / math.sqrt(12.0), rel=0.01)


BAR = 1.0e5


def test_pressures_that_a_log_rounds_to_bars_are_as_coarse_in_every_floor(
    robot: Robot, crane_run: Any
) -> None:
    """A file of transducers that tell 10 mbar says nothing of what a log makes of them."""
    whole = {n: BAR * np.round(getattr(crane_run, n) / BAR) for n in ("p_a", "p_b")}
    exact, rounded = (
        SignalSurvey.of(robot, traces_of([crane_run.recording(**columns)]))
        for columns in ({}, whole)
    )
    expected = BAR / math.sqrt(12.0)
    assert sensor_noise(robot, rounded)[2:] == pytest.approx(expected, rel=0.2)
    assert sensor_noise(robot, exact)[2:] == pytest.approx(4.0e3, rel=0.2)
    chamber, windows = chambers_of(robot)[0], WindowSettings(length_s=0.05)
    flows = [flow_noise(robot, chamber, one, windows, 1e-9) for one in (exact, rounded)]
    forces = [force_noise(force_model(robot), one, FilterSettings()) for one in (exact, rounded)]
    assert flows[1] > 3.0 * flows[0]
    assert np.all(forces[1] > 1.5 * forces[0])


def test_a_reading_that_stands_but_for_an_event_shows_no_step() -> None:
    """A transducer that is stuck, but for one glitch of 50 bar."""
    stuck = np.full(10_000, 20.0 * BAR)
    stuck[5000] += 50.0 * BAR
    sensor = Sensor()
    sensor.add(stuck, slice(0, stuck.size), 0.002)
    assert sensor.smallest_change == 50.0 * BAR
    assert sensor.step(1000.0) == 1000.0


def test_floors_are_the_same_whichever_recording_comes_first(robot: Robot, crane_run: Any) -> None:
    """Of two rates they lie between those of either, nearer the one that was recorded longer."""
    quick = crane_run.recording()
    slow = replace(
        crane_run.recording("slow"), period_s=0.02, stamp_ns=quick.stamp_ns[::10],
        **{n: getattr(quick, n)[::10] for n in (
            "q", "p_a", "p_b", "supply", "tank", "valve_v", "command_v", "latched"
        )},
    )  # fmt: skip
    filters, (chamber, *_) = FilterSettings().borne_at(0.02), chambers_of(robot)

    def floors(*recordings: Any) -> np.ndarray:
        seen = SignalSurvey.of(robot, traces_of(recordings))
        # Whole cycles of 20 ms fill 40 ms of it, of 2 ms all.
        flow = flow_noise(robot, chamber, seen, WindowSettings(length_s=0.05), 1e-9)
        return np.array([*force_noise(force_model(robot), seen, filters), flow])

    one, other = floors(quick, slow), floors(slow, quick)
    assert other == pytest.approx(one, rel=1e-12)
    twice = floors(quick, slow, replace(slow, path=Path("more")))
    assert (abs(twice - floors(slow)) < abs(one - floors(slow))).all()


@pytest.mark.parametrize("every", [1, 5, 10])
@pytest.mark.parametrize("spread_rad", [0.0, 2.0e-5])
def test_a_ringing_arm_is_no_noise_of_its_encoder(every: int, spread_rad: float) -> None:
    """At 50 samples per second third differences hold the motion, not what the encoder adds."""
    count, time = 2.0 * math.pi / 2**20, 1.0e-3 * np.arange(60_000)
    swing = 24.0e-3 * np.sin(2.0 * math.pi * 3.0 * time) * np.abs(np.cos(0.4 * time))
    swing = (swing + 0.3 * np.sin(0.5 * time))[:: 2 * every]
    random = np.random.default_rng(3).normal(size=swing.size)
    read = count * np.round((swing + spread_rad * random) / count)
    sensor = Sensor()
    sensor.add(read, slice(0, read.size), 2.0e-3 * every)
    true = math.hypot(spread_rad, count / math.sqrt(12.0))
    assert sensor.noise(count) == pytest.approx(true, rel=0.3)


def test_an_encoders_noise_weighs_as_the_inertia_that_was_fitted(
    robot: Robot, crane_run: Any
) -> None:
    """Twice the inertia of all links makes twice of it; pressures' noise stays as it is."""
    seen, filters = traces_of([crane_run.recording()]), FilterSettings()
    bare = tuple(replace(c, barrel=None, rod=None) for c in robot.cylinders)
    robot = replace(robot, cylinders=bare, part_inertia=None)
    model = force_model(robot)
    heavy = replace(robot, link_inertia=2.0 * robot.link_inertia)
    weightless = replace(robot, link_inertia=1e-9 * robot.link_inertia)
    plain, twice, none = (
        force_noise(model, seen, filters, one) ** 2 for one in (None, heavy, weightless)
    )
    assert np.all(none < 0.9 * plain)
    np.testing.assert_allclose(twice - none, 4.0 * (plain - none), rtol=1e-6)
    np.testing.assert_array_equal(plain, force_noise(model, seen, filters, robot) ** 2)
