"""Recordings of the model itself in closed loop, with noise of a chosen kind: no ROS, no rig.

The truth is the robot given; a slow position loop on the measured angles follows smooth
references through the valves, so that encoder noise gets into the motion as on a machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from hydro_ident.bag.recording import Recording
from hydro_model.hydraulics.cylinder import lever
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import simulate

STEP_S = 0.002
#: Cycles between two answers of the position loop, its gain, and the flow of a full valve.
_HOLD, _GAIN, _FULL_FLOW = 10, 2.0, 9.0e-7 * 2800.0
START_NS = 1_700_000_000_000_000_000


@dataclass(frozen=True, slots=True)
class Noise:
    """What is added to the sensors.

    Attributes
    ----------
    encoder_rad : float
        White; the position loop sees it, too.
    pressure_pa : float
        White.
    force_n : float
        Autoregressive (`phi` per sample), on the piston forces through chamber A's pressure.
    phi : float
    """

    encoder_rad: float = 3.0e-6
    pressure_pa: float = 4.0e3
    force_n: float = 0.0
    phi: float = 0.98


def references(time_s: ArrayLike) -> FloatArray:
    """References of the two joints of the crane xs031, (N, 2): slow sweeps with chirps."""
    t = np.asarray(time_s, dtype=float)
    fade = np.clip(t / 2.0, 0.0, 1.0)
    fade = fade * fade * (3.0 - 2.0 * fade)
    # Chirps start over every 20 s.
    s = np.mod(t, 20.0)
    lift = 0.35 * np.sin(2 * np.pi * 0.11 * t) + 0.006 * np.sin(2 * np.pi * (0.5 + 0.03 * s) * s)
    tilt = 0.50 * np.sin(2 * np.pi * 0.17 * t) + 0.008 * np.sin(2 * np.pi * (0.6 + 0.03 * s) * s)
    return np.asarray(np.array([0.55, -1.2]) + fade[..., None] * np.stack([lift, tilt], axis=-1))


_Driven = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


@lru_cache(maxsize=8)
def _driven(name: str, seconds: float, encoder_rad: float, seed: int, pace: float) -> _Driven:
    return _closed_loop(load_robot(name), seconds, encoder_rad, seed, pace)


def _closed_loop(
    robot: Robot, seconds: float, encoder_rad: float, seed: int, pace: float
) -> _Driven:
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds / STEP_S) + 1) * STEP_S
    jitter = encoder_rad * rng.normal(size=(time.size, robot.dof))
    voltage = np.zeros((time.size, len(robot.valves)))
    q, qd, pressures = references(time[:1])[0], np.zeros(robot.dof), None
    kept: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for k in range(0, time.size - 1, _HOLD):
        piece = slice(k, min(k + _HOLD + 1, time.size))
        ahead, later = references(pace * (time[k] + np.array([0.02, 0.021])))
        seen = q + jitter[k]
        for i, cylinder in enumerate(robot.cylinders):
            speed = (later[i] - ahead[i]) / 0.001 + _GAIN * (ahead[i] - seen[i])
            flow = float(lever(cylinder, q[i])) * speed * cylinder.area_a_m2
            voltage[piece, i] = np.clip(10.0 * flow / _FULL_FLOW, -9.0, 9.0)
        out = simulate(robot, time[piece], voltage[piece], q, qd, pressures)
        q, qd = out.q[-1], out.qd[-1]
        pressures = np.stack([out.p_a[-1], out.p_b[-1]], axis=1)
        kept.append((out.q[:-1], out.p_a[:-1], out.p_b[:-1]))
    true_q, p_a, p_b = (np.concatenate(c) for c in zip(*kept, strict=True))
    count = len(true_q)
    return true_q, p_a, p_b, voltage[:count], jitter[:count]


def synthetic_recording(
    robot: Robot,
    seconds: float,
    seed: int = 0,
    noise: Noise | None = None,
    pace: float = 1.0,
) -> Recording:
    """A recording of the model in closed loop.

    Parameters
    ----------
    robot : Robot
        A shipped one with two joints, other effects than its own allowed; its command delay is
        taken as zero.
    seconds : float
    seed : int
        Of the noise.
    noise : Noise, optional
    pace : float
        Of the references.

    Returns
    -------
    Recording
        With the references that the loop followed.
    """
    noise = noise or Noise()
    q, p_a, p_b, voltage, jitter = (
        _closed_loop(robot, seconds, noise.encoder_rad, seed, pace)
        if robot.effects
        else _driven(robot.name, seconds, noise.encoder_rad, seed, pace)
    )
    readings = _readings(robot, p_a, p_b, noise, seed)
    count = len(q)
    rails = np.ones(count)
    return Recording(
        path=Path(f"synthetic_{seed}"),
        robot=robot,
        stamp_ns=START_NS + np.arange(count) * 2_000_000,
        period_s=STEP_S,
        q=q + jitter,
        stroke=None,
        effort=None,
        p_a=readings[0],
        p_b=readings[1],
        supply=robot.supply_pressure_pa * rails,
        tank=robot.tank_pressure_pa * rails,
        valve_v=voltage.copy(),
        valve_source="/valve_state",
        command_v=voltage.copy(),
        spool=None,
        latched=np.zeros(count, dtype=bool),
        q_ref=references(pace * np.arange(count) * STEP_S),
        qd_ref=None,
        force_ref=None,
        tip_ref=None,
        temperature_stamp_ns=None,
        temperature_c=None,
        losses=(),
        gaps=(),
        duplicates={},
        notes=(),
        metadata={},
    )


def _readings(
    robot: Robot, p_a: FloatArray, p_b: FloatArray, noise: Noise, seed: int
) -> list[FloatArray]:
    """Pressures as they are read: a slow force that is in no model, then what transducers add."""
    from scipy.signal import lfilter

    rng, (count, cylinders) = np.random.default_rng(seed + 1000), p_a.shape
    white = rng.normal(size=(count + 1000, cylinders)) * np.sqrt(1.0 - noise.phi**2)
    slow = noise.force_n * lfilter([1.0], [1.0, -noise.phi], white, axis=0)[1000:]
    areas = np.array([c.area_a_m2 for c in robot.cylinders])
    return [p + noise.pressure_pa * rng.normal(size=p.shape) for p in (p_a + slow / areas, p_b)]
