"""The size of an effect that the best of tests would find half of the time, before any diagnosis.

The likelihood-ratio test with the true structure knows the effect's trace, lets a refit take up
what it can, and knows the spectrum of the noise: sensor noise with its rounding, carried into each
channel, and the random forces and spool motions. Its statistic is chi-squared of one degree of
freedom, not central by ``|W (d - X b)|^2`` with the trace d, the refit's columns X and the noise's
whitening W. Half power at a level of 1 % asks for a noncentrality of 6.63, and for small effects
the trace grows like the size.

Rows of a joint that rests are left out: what dry friction does there is whatever holds the load,
and a valve's signal whatever the controller makes of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_hw_bridge.rig.plant import Plant
from hydro_ident.study.hidden import Machine
from hydro_ident.study.traces import EVERY, Drive, nuisance, thinned, trace
from hydro_model.robot import FloatArray

#: 50 % power at the 1 % level, one degree of freedom.
HALF_POWER = 6.632
#: Channels with this share of the noncentrality are right places for a finding.
_STRONG = 0.2
#: A joint rests where it is slower than this share of its usual fast speed.
REST_SPEED = 0.01


@dataclass(frozen=True, slots=True)
class Detectability:
    """How far an effect of a size is above what can be seen.

    Attributes
    ----------
    noncentrality : float
    limit : float
        Size of half power at 1 %, in the effect's unit.
    shares : dict of str to float
        Of the noncentrality, by channel.
    """

    noncentrality: float
    limit: float
    shares: dict[str, float]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that carry the trace, the strongest first."""
        top = max(self.shares.values(), default=0.0)
        ranked = sorted(self.shares, key=lambda name: -self.shares[name])
        return tuple(n for n in ranked if top > 0.0 and self.shares[n] >= _STRONG * top)


def detectability(run: Drive, plain: Machine, size: float, *, delay: bool) -> Detectability:
    """How visible a run's hidden effect is.

    Parameters
    ----------
    run : Drive
        Of the machine with the effect.
    plain : Machine
        The machine without it.
    size : float
        The effect's.
    delay : bool
        A refit may shift the command.
    """
    m = len(plain.robot.cylinders)
    left = trace(run, plain)
    spectra = noise_spectra(run, plain)
    columns = nuisance(run, plain, delay=delay)
    moves = moving(run, plain)
    forces, powers = list(range(0, 3 * m, 3)), {}
    rest = _whitened(np.concatenate([left[:, c] for c in forces]), spectra, forces)
    kept = np.concatenate(list(moves.T))
    rest = _without(rest * kept, _whitened(columns[0], spectra, forces) * kept[:, None])
    for k, c in enumerate(forces):
        powers[c] = float(np.sum(rest.reshape(m, -1)[k] ** 2))
    flows = [c for c in range(3 * m) if c % 3]
    for matrix, c in zip(columns[1:], flows, strict=True):
        rest, kept = _whitened(left[:, c], spectra, [c]), moves[:, c // 3]
        rest = _without(rest * kept, _whitened(matrix, spectra, [c]) * kept[:, None])
        powers[c] = float(np.sum(rest**2))
    total = sum(powers.values())
    names = channel_names(plain)
    limit = size * np.sqrt(HALF_POWER / total) if total > 0.0 else np.inf
    shares = {names[c]: powers[c] / max(total, 1e-300) for c in range(3 * m)}
    return Detectability(total, float(limit), shares)


def moving(run: Drive, plain: Machine) -> FloatArray:
    """1 where a cylinder's joint moves and 0 where it rests, (N // EVERY, m)."""
    robot, n = plain.robot, plain.robot.dof
    speed = np.abs(run.track.states[:, n : 2 * n])
    joints = [robot.joint_index(c.joint) for c in robot.cylinders]
    fast = speed[:, joints] > REST_SPEED * np.quantile(speed[:, joints], 0.95, axis=0)
    return np.asarray(thinned(fast.astype(float)) > 0.5, dtype=np.float64)


def channel_names(machine: Machine) -> list[str]:
    """Of the columns of a trace."""
    kinds = ("force", "flow_a", "flow_b")
    return [f"{c.joint}/{kind}" for c in machine.robot.cylinders for kind in kinds]


def noise_spectra(run: Drive, plain: Machine) -> list[FloatArray]:
    """Noise power of every column of a trace at the frequencies of its real transform.

    One-sided densities times half the sampling rate: white noise of a variance has that value.
    """
    robot, truth = plain.robot, plain.truth
    n, m, rate = robot.dof, len(robot.cylinders), robot.sensors.rate_hz
    states = run.track.states
    count = len(states) // EVERY
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(count, EVERY / rate), dtype=np.float64)
    sensors = truth.sensors
    p_var = sensors.pressure_noise_pa**2 + robot.sensors.pressure_resolution_pa**2 / 12.0
    middle = np.median(states[:, :n], axis=0)
    inertia, _, lever = Plant(robot, truth, states[0, :n]).equations(middle, np.zeros(n))
    plant = Plant(robot, truth, states[0, :n])
    plant.state[:n] = middle
    stroke, spectra = plant.strokes(), []
    extras, instruments = truth.extras.machine, truth.extras.sensors
    wander = _coloured(omega, instruments.wander_time_s, rate)
    pressure = p_var + instruments.wander_pa**2 * wander
    for i, cylinder in enumerate(robot.cylinders):
        joint = robot.joints[robot.joint_index(cylinder.joint)]
        turn = 1.0 if joint.prismatic else 2.0 * np.pi
        count_size = turn / robot.sensors.encoder_counts_per_rev
        q_var = count_size**2 * (sensors.encoder_noise_counts**2 + 1.0 / 12.0)
        a, b = cylinder.area_a_m2, cylinder.area_b_m2
        j = robot.joint_index(cylinder.joint)
        mass, arm = inertia[j, j] / abs(lever[i]), abs(lever[i])
        force = (a * a + b * b) * pressure + (mass * omega**2) ** 2 * q_var
        force = force + extras.disturbance_n**2 * _coloured(omega, extras.disturbance_time_s, rate)
        spectra.append(force / EVERY)
        valve = robot.valve_of(cylinder.name)
        shake = extras.shake**2 * _coloured(omega, extras.shake_time_s, rate)
        volumes = a * stroke[i], b * (cylinder.stroke_m - stroke[i])
        for area, volume, column in zip((a, b), volumes, (2 * n + i, 2 * n + m + i), strict=True):
            soft = max(volume, 1.0e-4) / truth.fluid.bulk_modulus_pa
            # The edge's flow follows the spool, and the noise of the pressure by its slope.
            drop = max(0.5 * (truth.supply.pressure_pa), float(np.median(states[:, column])))
            gain, slope = valve.c_pa * np.sqrt(drop), 0.1 * valve.c_pa / (2.0 * np.sqrt(drop))
            flow = (soft * omega) ** 2 * pressure + (area * arm * omega) ** 2 * q_var
            spectra.append((flow + slope**2 * pressure + gain**2 * shake) / EVERY)
    return spectra


def _coloured(omega: FloatArray, time_s: float, rate_hz: float) -> FloatArray:
    """Density of a first-order process of variance 1, times half the sampling rate."""
    return np.asarray(2.0 * time_s * rate_hz / (1.0 + (omega * time_s) ** 2))


def _filtered(values: FloatArray, power: FloatArray) -> FloatArray:
    spectrum = np.fft.rfft(values, axis=0)
    weight = 1.0 / np.sqrt(power)
    return np.asarray(np.fft.irfft((spectrum.T * weight).T, n=len(values), axis=0))


def _whitened(rows: FloatArray, spectra: list[FloatArray], channels: list[int]) -> FloatArray:
    parts = np.split(rows, len(channels))
    return np.concatenate([_filtered(p, spectra[c]) for p, c in zip(parts, channels, strict=True)])


def _without(rest: FloatArray, columns: FloatArray) -> FloatArray:
    """What the columns cannot take up."""
    if columns.shape[1] == 0:
        return rest
    scale = np.linalg.norm(columns, axis=0)
    basis, size, _ = np.linalg.svd(
        columns / np.where(scale > 0.0, scale, 1.0), full_matrices=False
    )
    basis = basis[:, size > 1.0e-9 * size[0]]
    return np.asarray(rest - basis @ (basis.T @ rest))
