"""Compensation on the rig's truth plant, whose physics has other forms than the catalogue's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import Truth
from hydro_model.description.urdf import standard_parameters
from hydro_model.motion.paths import JointPath, Path, TipPath, load_path
from hydro_model.motion.paths_segments import Quintic
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
SEED = 103
START, END = (0.6, -1.5), (0.7, -1.35)
HOLD_S = 5.0


def base_model(truth: Truth) -> Robot:
    """The machine's own base parameters: inertia, viscous friction, oil and edges."""
    links = [standard_parameters(t.mass_kg, t.com_m, t.inertia_com_kg_m2) for t in truth.links]
    return replace(
        ROBOT,
        link_inertia=np.array(links),
        cylinders=tuple(
            replace(
                c,
                viscous_friction=t.viscous_friction,
                bulk_modulus_pa=truth.fluid.bulk_modulus_pa,
                barrel=t.barrel,
                rod=t.rod,
            )
            for c, t in zip(ROBOT.cylinders, truth.cylinders, strict=True)
        ),
        valves=tuple(
            replace(v, c_pa=t.c_pa, c_at=t.c_at, c_pb=t.c_pb, c_bt=t.c_bt)
            for v, t in zip(ROBOT.valves, truth.valves, strict=True)
        ),
        command_delay_s=0.002,
    )


def described(truth: Truth, rubbing: float = 1.0, overlap: float = 1.0) -> Robot:
    """With the catalogue's nearest effects; friction and overlap off by a factor."""
    effects: list[EffectSpec] = []
    for c, v in zip(truth.cylinders, truth.valves, strict=True):
        step = c.static_friction_n - c.coulomb_friction_n
        values: tuple[tuple[str, str, dict[str, float]], ...] = (
            ("coulomb_friction", c.name, {"force": rubbing * c.coulomb_friction_n}),
            (
                "stribeck_friction",
                c.name,
                {"force": step, "stribeck_velocity": c.stribeck_velocity_m_s},
            ),
            (
                "dead_volume",
                c.name,
                {"volume_a": c.dead_volume_a_m3, "volume_b": c.dead_volume_b_m3},
            ),
            ("internal_leakage", c.name, {"coefficient": c.internal_leakage}),
            ("valve_deadband", v.name, {"width": overlap * v.deadband}),
            ("valve_null_bias", v.name, {"bias": v.null_bias}),
            (
                "valve_spool_lag",
                v.name,
                {"frequency": v.natural_frequency_hz, "damping": v.damping_ratio},
            ),
        )
        effects += [EffectSpec(*one) for one in values]
    return replace(base_model(truth), effects=tuple(effects))


@dataclass(frozen=True)
class Run:
    """By cycle: distance of the true tip from its reference, voltages."""

    error_m: FloatArray
    tip_m: FloatArray
    voltage_v: FloatArray


def drive(truth: Truth, model: Robot, path: Path, seconds: float) -> Run:
    if isinstance(path, TipPath):
        rig = RigCore(ROBOT, truth, seed=1, tip_m=path.sample(0.0)[0].tolist())
    else:
        rig = RigCore(ROBOT, truth, seed=1, q=START)
    assert isinstance(path, TipPath | JointPath)
    core = ControllerCore(model, Gains(), path, start_delay_s=0.5)
    error, tips, voltages = [], [], []
    for k in range(round(seconds / rig.cycle_s)):
        read = rig.readings().measurement
        pressure = np.array(read.pressures_pa) + ROBOT.atmospheric_pressure_pa
        chambers = pressure[:4].reshape(2, 2)
        stamp_ns, q = 10**18 + k * 2_000_000, np.array(read.positions)
        lines = float(pressure[4]), float(pressure[5])
        sample = Sample(stamp_ns, q, chambers[:, 0], chambers[:, 1], *lines)
        answer = core.answer(sample)
        assert answer is not None
        assert not answer.output.fault
        tip = rig.plant.tip()[:3]
        error.append(np.linalg.norm(tip - answer.output.tip_d_m))
        tips.append(tip)
        voltages.append(answer.output.voltage_v)
        rig.actuate(answer.output.voltage_v.tolist())
    return Run(np.array(error), np.array(tips), np.array(voltages))


@cache
def hold(rubbing: float, overlap: float) -> Run:
    """A small motion, then five seconds at rest; factors of 0: no effect listed."""
    truth = random_truth(ROBOT, SEED)
    model = described(truth, rubbing, overlap) if rubbing else base_model(truth)
    segment = Quintic.at_rest(list(START), list(END), 1.5)
    path = JointPath((segment,), joints=ROBOT.joint_names)
    return drive(truth, model, path, 2.0 + 0.5 + HOLD_S)


@pytest.mark.thorough
def test_half_the_parallelogram_is_followed_four_times_better() -> None:
    truth, path = random_truth(ROBOT, SEED), load_path("xs031/parallelogram")
    before = drive(truth, base_model(truth), path, 9.0).error_m
    after = drive(truth, described(truth), path, 9.0).error_m
    assert np.sqrt(np.mean(after**2)) < 0.25 * np.sqrt(np.mean(before**2))
    assert after.max() < 0.5 * before.max()


@pytest.mark.parametrize(("rubbing", "overlap"), [(1.0, 1.0), (1.3, 1.5)])
def test_a_pose_is_held_without_hunting(rubbing: float, overlap: float) -> None:
    """Noise passes to the valve, but neither voltage nor tip swings, even overcompensated."""
    run, rows = hold(rubbing, overlap), round(HOLD_S * 500)
    voltage = run.voltage_v[-rows:] - run.voltage_v[-rows:].mean(axis=0)
    # A limit cycle is slow beside the noise: averaged over 50 ms, what is left of the voltage
    # stays within half of a valve's overlap (0.07 to 0.13 V).
    smooth = np.array([np.convolve(v, np.full(25, 0.04), "valid") for v in voltage.T])
    assert smooth[:, rows // 2 :].std(axis=1).max() < 0.06
    assert voltage.std(axis=0).max() < 0.5
    assert np.linalg.norm(np.ptp(run.tip_m[-500:], axis=0)) < 5e-4


def test_a_pose_is_held_nearer() -> None:
    assert hold(1.0, 1.0).error_m[-500:].mean() < 0.3 * hold(0.0, 0.0).error_m[-500:].mean()
