"""Compensation of the effects that the model file lists, in the equations where each belongs.

The laws are the catalogue's own (`hydro_model.effects`), compiled
(`hydro_control.compensation.listed_kernels`); the same, readable, is in
`hydro_control.compensation.compensation_reference`. Friction joins eq. 22 at the required
motion. Volumes and compliances make the oil columns of eqs. 14, 23 and 24 longer, and flow past
the valve joins eq. 23. Laws on the valve signal are inverted after eq. 24. What acts late is met
by looking ahead: required quantities belong to the instant at which the valve will have answered.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_control.compensation.listed_arrays import listed_arrays, listed_work
from hydro_control.compensation.listed_kernels import (
    columns_kernel,
    friction_kernel,
    observe_kernel,
    signals_kernel,
)
from hydro_control.compensation.signal_inverse import SignalInverse, lag_s
from hydro_control.state.axes import Axis
from hydro_control.state.filters import alpha_for
from hydro_control.state.oil_columns import OilColumns
from hydro_model.effects import ActiveEffect, Stage
from hydro_model.effects import signals as sig
from hydro_model.robot import FloatArray, Robot

#: Smallest rounding of the sign of a required velocity: a step of friction would be a step of
#: the required force, and at rest one way of the noise after the other.
SMALLEST_SCALE_M_S = 0.005
#: Time constant of the average through which the wanted opening passes before the inverse says
#: how far the signal must be off it: noise must not be thrown across an overlap.
SHAPING_S = 0.009


@dataclass(frozen=True, slots=True)
class Motion:
    """One sample as laws see it; arrays are (n,), one per joint.

    Attributes
    ----------
    time_s : float
    q, qd, qdd : array
        Positions, and the velocities and accelerations that laws are asked for.
    arm : array
        Levers dx/dq.
    x : array
        Piston positions from the bottom, as they are: laws of them were identified so. Only the
        oil is counted on as softer near the ends (`hydro_control.state.oil_columns`).
    pressures : (2, m) array
        Gauge, per cylinder.
    p_s, p_t : float
    force_n : array
        Piston forces.
    """

    time_s: float
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    arm: FloatArray
    x: FloatArray
    pressures: FloatArray
    p_s: float
    p_t: float
    force_n: FloatArray


class Compensation:
    """The listed effects of one robot, sample by sample.

    Parameters
    ----------
    robot : Robot
        The changed robot of a plan.
    effects : sequence of ActiveEffect
        Those to compensate.
    axes : sequence of Axis
    dt_s : float
        Time between two calls of `observe`.
    smallest_scale_m_s : float
        Smallest rounding of the sign of a velocity.

    Attributes
    ----------
    any : bool
        There is something to compensate.
    arrays : ListedArrays
    work : ListedWork
        What the kernels take.
    delay_s : float
        From a command to the opening of the edges: the robot's delay, the largest lag of a
        valve, and half a sample for which commands are held.
    force_lag_s : (n,) array
        By which pressures, and so forces, are late.

    Raises
    ------
    ControlError
        The laws of a valve cannot be inverted.
    """

    def __init__(
        self,
        robot: Robot,
        effects: Sequence[ActiveEffect],
        axes: Sequence[Axis],
        dt_s: float,
        smallest_scale_m_s: float = SMALLEST_SCALE_M_S,
    ) -> None:
        self._dt_s = dt_s
        self.any = bool(effects)
        own = [tuple(a for a in effects if a.cylinder == x.cylinder_index) for x in axes]
        lags = [sum(lag_s(a) for a in chain if a.effect.states) for chain in map(_chain, own)]
        late = [lag + axis.valve.command_delay_s for lag, axis in zip(lags, axes, strict=True)]
        self.delay_s = robot.command_delay_s + max(late) + 0.5 * dt_s
        self.force_lag_s = np.array([_pressure_delay_s(one) for one in own])
        self._inverses = inverses_of(effects, axes)
        given = effects, axes, self._inverses, smallest_scale_m_s
        self.arrays = listed_arrays(robot, *given)
        self.work = listed_work(robot, axes, self.arrays)
        self._fading = 1.0 - alpha_for(SHAPING_S, dt_s)

    def reset(self) -> None:
        """Forget all samples."""
        work = self.work
        work.signals[:, sig.VALVE_SIGNAL] = 0.0
        work.states[:] = work.leak[:] = work.slow[:] = np.nan

    def observe(self, motion: Motion) -> None:
        """Take one sample.

        Parameters
        ----------
        motion : Motion
        """
        m, moved = motion, (motion.q, motion.qd, motion.qdd, motion.arm, motion.x)
        oil = m.pressures, float(m.p_s), float(m.p_t), m.force_n
        observe_kernel(self.arrays, self.work, m.time_s, *moved, *oil, self._dt_s)

    def friction(self) -> FloatArray:
        """Listed friction at the motion observed last, against it, (n,) N."""
        out = np.zeros(len(self._inverses))
        friction_kernel(self.arrays, self.work, out)
        return out

    def columns(self, plain: OilColumns) -> OilColumns:
        """Oil columns with the listed volumes, compliances and flows.

        A chamber of volume V and compliance 1/beta' is as soft as a column of
        ``V beta / (beta' A)`` of the cylinder's own oil: ``x + V0 / A1`` for a dead volume.

        `plain` are the columns without effects.
        """
        a, b = plain.a_m.copy(), plain.b_m.copy()
        columns_kernel(self.arrays, self.work, a, b)
        return OilColumns(a, b, self.work.leak.copy())

    def signals(self, opening: FloatArray, steps: int = 1) -> FloatArray:
        """Signals (n,) to give for the openings wanted by eq. 24, after `steps` sample times."""
        out = np.empty(len(opening))
        signals_kernel(self.arrays, self.work, opening, self.past_opening(steps), out)
        return out

    def past_opening(self, steps: int) -> float:
        """What `steps` sample times leave of the average of the openings before."""
        return float(self._fading**steps)

    def openings(self, signal: FloatArray) -> FloatArray:
        """Openings (n,) that signals give, and which `columns` takes from here on."""
        out = np.array(
            [
                u if inverse is None else inverse.opening(u)
                for inverse, u in zip(self._inverses, signal.tolist(), strict=True)
            ]
        )
        self.work.signals[:, sig.VALVE_SIGNAL] = out
        return out


def inverses_of(
    effects: Sequence[ActiveEffect], axes: Sequence[Axis]
) -> list[SignalInverse | None]:
    """Inverses of the valves' laws, axis by axis; None where none is listed.

    Parameters
    ----------
    effects : sequence of ActiveEffect
    axes : sequence of Axis

    Raises
    ------
    ControlError
        The laws of a valve cannot be inverted.
    """
    chains = [_chain([a for a in effects if a.cylinder == x.cylinder_index]) for x in axes]
    return [
        SignalInverse(chain, axis.valve.name) if chain else None
        for chain, axis in zip(chains, axes, strict=True)
    ]


def _chain(effects: Iterable[ActiveEffect]) -> list[ActiveEffect]:
    """Those on the valve signal."""
    return [a for a in effects if any(term.stage is Stage.SIGNAL for term in a.terms)]


def _pressure_delay_s(effects: Sequence[ActiveEffect]) -> float:
    """Mean delay of the two chambers."""
    return 0.5 * sum(float(a.parameters[0]) for a in effects if a.effect.name == "pressure_delay")
