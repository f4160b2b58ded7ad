"""When joints rest, and how often they turn: of recordings in which they hardly ever move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.forces.force_rows import force_model
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.naming.few_motions import FewMotions
from hydro_ident.mismatch.rows.choices import Choices, choices_of
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.rests import motions_in, moving_rows, usual_size
from hydro_ident.mismatch.rows.testable import untestable
from hydro_ident.mismatch.split.parts import spread_parts
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

STEP_S, SECONDS = 0.01, 300.0
LIFT, TILT = 0, 1


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("xs031")


def _trace(robot: Robot, speeds: np.ndarray, noise: float, signal: float) -> Trace:
    """Joints at given speeds (N, 2), valves open by them and by a controller's answer to noise."""
    rng, (count, _) = np.random.default_rng(0), speeds.shape
    q = np.array([0.5, -1.3]) + STEP_S * np.cumsum(speeds, axis=0)
    valve = 0.3 * speeds / np.abs(speeds).max(axis=0) + signal * rng.normal(size=speeds.shape)
    q += noise * rng.normal(size=q.shape)
    x = np.stack([stroke(c, q[:, k]) for k, c in enumerate(robot.cylinders)], axis=1)
    pressure = 5.0e6 + 1e3 * rng.normal(size=q.shape)
    one = np.ones(count)
    return Trace(
        "bag#0", STEP_S, STEP_S * np.arange(count), q, x, pressure, pressure, 18.0e6 * one, one,
        valve, np.full(q.shape, np.nan),
    )  # fmt: skip


def _bursts(share: float, count: int = 9, one_way: bool = False) -> np.ndarray:
    """Speeds (N,) of a joint that moves so much of the time, to and fro by turns."""
    time, every = STEP_S * np.arange(round(SECONDS / STEP_S)), SECONDS / count
    phase = np.mod(time, every) / every / share
    sign = 1.0 if one_way else np.where((time // every).astype(int) % 2, -1.0, 1.0)
    return np.asarray(np.where(phase < 1.0, 0.2 * sign * np.sin(np.pi * phase) ** 2, 0.0))


def _speeds(tilt: np.ndarray) -> np.ndarray:
    """The lift to and fro without rest, and the tilt joint as given."""
    time = STEP_S * np.arange(tilt.size)
    return np.stack([0.2 * np.sin(0.8 * time), tilt], axis=1)


def _material(robot: Robot, traces: tuple[Trace, ...]) -> Material:
    return material_of(robot, force_model(robot), traces, FilterSettings(), WindowSettings(), {})


@pytest.mark.parametrize("share", [0.02, 0.03, 0.045, 0.06, 0.3])
def test_a_joint_that_hardly_ever_moves_rests_the_remainder(robot: Robot, share: float) -> None:
    trace = _trace(robot, _speeds(_bursts(share)), 3e-7, 2e-3)
    material = _material(robot, (trace,))
    moving = moving_rows(material)
    for name in ("tilt/force", "tilt/flow_a", "tilt/flow_b"):
        own = material.channel == material.channels.index(name)
        # The filters smear rests into both ends of nine motions.
        assert 0.4 * share < moving[own].mean() < 1.2 * share, name
    own = material.channel == material.channels.index("lift/force")
    assert moving[own].mean() > 0.9


@pytest.mark.parametrize("share", [0.05, 0.09, 0.12, 0.5])
def test_noise_is_weighed_against_the_speed_of_motions_however_rare(
    robot: Robot, share: float
) -> None:
    """A 12-bit encoder: the filters that motion can bear do not ask how long the joint rests."""
    count = 2.0 * np.pi / 4096.0

    def filters(tilt: np.ndarray) -> float:
        seen = _trace(robot, _speeds(0.2 * tilt), 0.0, 0.0)
        q = seen.q.copy()
        q[:, TILT] = count * np.round(q[:, TILT] / count)
        q[:, LIFT] += 1e-7 * np.random.default_rng(1).normal(size=len(q))
        coarse = Trace(*(q if f == "q" else getattr(seen, f) for f in list(seen.__slots__)))
        found = choices_of(force_model(robot), SignalSurvey.of(robot, [coarse]), [coarse])
        return found.filters.differentiation_hz

    always = filters(_bursts(1.0))
    assert always < 0.7 * Choices().filters.differentiation_hz
    assert filters(_bursts(share)) == pytest.approx(always, rel=0.25)


def test_what_never_moves_has_no_usual_size() -> None:
    assert usual_size([]) is None
    assert usual_size([np.full(9, np.nan)]) is None
    assert usual_size([np.zeros(1000), np.full(9, np.nan)]) == 0.0


def test_of_what_moves_throughout_hardly_any_exceeds_the_usual_size() -> None:
    sizes = np.abs(np.sin(np.linspace(0.0, 60.0, 10_000)))
    assert usual_size([sizes]) == pytest.approx(float(np.quantile(sizes, 0.95)), rel=2e-3)


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_steps_one_way_are_one_motion_and_those_to_and_fro_are_one_each(
    robot: Robot, count: int
) -> None:
    """Of a travel in steps friction, gravity and levers are one curve over the position."""
    for one_way, motions in ((True, 1), (False, count)):
        tilt = 0.3 * _bursts(0.4 / count if one_way else 0.2, count, one_way)
        speeds = np.stack([np.zeros_like(tilt), tilt], axis=1)
        material = _material(robot, (_trace(robot, speeds + 1e-12, 0.0, 0.0),))
        assert motions_in(material) == motions
        friction = untestable(material, CATALOGUE["coulomb_friction"])
        assert friction.startswith("the joints move one way only") == (motions < 2)


def test_what_a_joint_shows_in_one_sweep_is_no_sample_however_often_another_turns(
    robot: Robot,
) -> None:
    """Of what moves to and fro each block counts; of what sweeps once all of them are one."""
    tilt = 0.3 * _bursts(0.2, 8, False)
    sweeping = _trace(robot, np.stack([np.full(tilt.size, 0.01), tilt], axis=1), 0.0, 0.0)
    # What stands still has no curve over its position.
    still = replace(sweeping, q=np.stack([np.full(tilt.size, 0.5), sweeping.q[:, 1]], axis=1))
    for trace, alone in ((sweeping, 40.0), (still, 1.0)):
        few = FewMotions(_material(robot, (trace,)), 40.0)
        for target, counted in (("lift_cylinder", alone), ("tilt_cylinder", 1.0)):
            spec = EffectSpec("coulomb_friction", target, {"force": 1e3})
            assert few.of(resolve(replace(robot, effects=(spec,)))) == counted
        load = EffectSpec("payload_change", "xs031", {"mass": 50.0})
        bias = EffectSpec("valve_null_bias", "lift_valve", {"bias": 0.01})
        for spec in (load, bias):
            assert few.of(resolve(replace(robot, effects=(spec,)))) == 1.0


def test_what_filters_make_of_a_recordings_ends_is_no_motion(robot: Robot) -> None:
    """A sweep that begins and ends at full speed: filters swing there, the joint does not."""
    tilt = np.full(round(SECONDS / STEP_S), 0.01)
    trace = _trace(robot, np.stack([tilt, tilt], axis=1), 0.0, 0.0)
    kicked = trace.q.copy()
    kicked[:20] += 1e-3 * np.linspace(1.0, 0.0, 20)[:, None] ** 2
    kicked[-20:] -= 1e-3 * np.linspace(0.0, 1.0, 20)[:, None] ** 2
    assert motions_in(_material(robot, (replace(trace, q=kicked),))) == 1


def test_a_sweep_in_parts_is_one_motion(robot: Robot) -> None:
    tilt = np.full(round(SECONDS / STEP_S), 0.004)
    whole = (_trace(robot, np.stack([0.5 * tilt, tilt], axis=1), 0.0, 0.0),)
    parts = spread_parts(whole, 80.0)
    assert len(parts) == 8
    assert motions_in(_material(robot, parts)) == 1


def test_motions_are_counted_across_parts(robot: Robot) -> None:
    """There and back in parts that each see one way."""
    time = STEP_S * np.arange(round(SECONDS / STEP_S))
    tilt = 0.004 * np.sign(np.sin(2.0 * np.pi * (time + 0.5) / 150.0))
    whole = (_trace(robot, np.stack([0.0 * tilt, tilt], axis=1) + 1e-12, 0.0, 0.0),)
    material = _material(robot, spread_parts(whole, 80.0))
    assert motions_in(material) == 4
