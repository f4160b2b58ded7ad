"""Compensation of the effects that the model file lists, in the equations where each belongs.

The laws are the catalogue's own (`hydro_model.effects`). Friction joins eq. 22 at the required
motion. Volumes and compliances make the oil columns of eqs. 14, 23 and 24 longer, and flow past
the valve joins eq. 23. Laws on the valve signal are inverted after eq. 24. What acts late is met
by looking ahead: required quantities belong to the instant at which the valve will have answered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_control.axes import Axis
from hydro_control.filters import Ewma, alpha_for
from hydro_control.listed_laws import ListedLaws, Signals, blank
from hydro_control.oil_columns import OilColumns
from hydro_control.signal_inverse import SignalInverse, lag_s
from hydro_model import signals as sig
from hydro_model.effects import ActiveEffect, Stage
from hydro_model.effects.rows import constant_signals, other_joint
from hydro_model.robot import FloatArray, Robot

#: Smallest rounding of the sign of a required velocity: a step of friction would be a step of
#: the required force, and at rest one way of the noise after the other.
SMALLEST_SCALE_M_S = 0.005
#: Time constant of the average through which the wanted opening passes before the inverse says
#: how far the signal must be off it: noise must not be thrown across an overlap.
SHAPING_S = 0.009
#: Weight of the newest flow past the valve: laws of the opening see that of the sample before,
#: and half a step towards them cannot overshoot.
_FLOW_WEIGHT = 0.5


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
        oil is counted on as softer near the ends (`hydro_control.oil_columns`).
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
        self._axes, self._dt_s = tuple(axes), dt_s
        self.any = bool(effects)
        own = [tuple(a for a in effects if a.cylinder == x.cylinder_index) for x in axes]
        self._laws = [ListedLaws(one, smallest_scale_m_s) for one in own]
        chains = [[a for a in one if _on_signal(a)] for one in own]
        self._inverses = [
            SignalInverse(chain, axis.valve.name) if chain else None
            for chain, axis in zip(chains, axes, strict=True)
        ]
        lags = [sum(lag_s(a) for a in chain if a.effect.states) for chain in chains]
        late = [lag + axis.valve.command_delay_s for lag, axis in zip(lags, axes, strict=True)]
        self.delay_s = robot.command_delay_s + max(late) + 0.5 * dt_s
        self.force_lag_s = np.array([_pressure_delay_s(one) for one in own])
        self._others = [other_joint(robot, robot.joint_index(a.joint.name)) for a in axes]
        self._rows = [_row(robot, axis.cylinder_index) for axis in axes]
        self._wanted = Ewma(alpha_for(SHAPING_S, dt_s))
        self._leak = Ewma(_FLOW_WEIGHT)
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        for laws in self._laws:
            laws.reset()
        for row in self._rows:
            row[sig.VALVE_SIGNAL] = 0.0
        self._wanted.reset()
        self._leak.reset()

    def observe(self, motion: Motion) -> None:
        """Take one sample.

        Parameters
        ----------
        motion : Motion
        """
        q, qd, qdd, arm = (part.tolist() for part in (motion.q, motion.qd, motion.qdd, motion.arm))
        force, x, pressures = motion.force_n.tolist(), motion.x.tolist(), motion.pressures
        for i, row in enumerate(self._rows):
            at, other = self._axes[i].cylinder_index, self._others[i]
            row[sig.TIME] = motion.time_s
            row[sig.JOINT_POSITION], row[sig.JOINT_VELOCITY] = q[i], qd[i]
            row[sig.PISTON_POSITION], row[sig.PISTON_VELOCITY] = x[i], arm[i] * qd[i]
            row[sig.LEVER], row[sig.PISTON_FORCE] = arm[i], force[i]
            row[sig.PRESSURE_A] = float(pressures[0, at])
            row[sig.PRESSURE_B] = float(pressures[1, at])
            row[sig.SUPPLY_PRESSURE], row[sig.TANK_PRESSURE] = motion.p_s, motion.p_t
            if other >= 0:
                row[sig.OTHER_POSITION], row[sig.OTHER_VELOCITY] = q[other], qd[other]
                row[sig.OTHER_ACCELERATION] = qdd[other]
            self._laws[i].advance(row, self._dt_s)

    def friction(self) -> FloatArray:
        """Listed friction at the motion observed last, against it, (n,) N."""
        return np.array([self._total(i, Stage.FRICTION) for i in range(len(self._axes))])

    def columns(self, plain: OilColumns) -> OilColumns:
        """Oil columns with the listed volumes, compliances and flows.

        A chamber of volume V and compliance 1/beta' is as soft as a column of
        ``V beta / (beta' A)`` of the cylinder's own oil: ``x + V0 / A1`` for a dead volume.

        `plain` are the columns without effects.
        """
        a, b, leak = plain.a_m.copy(), plain.b_m.copy(), np.zeros_like(plain.a_m)
        for i, axis in enumerate(self._axes):
            c = axis.cylinder
            a[i] += self._total(i, Stage.VOLUME_A) / c.area_a_m2
            b[i] += self._total(i, Stage.VOLUME_B) / c.area_b_m2
            a[i] *= 1.0 + c.bulk_modulus_pa * self._total(i, Stage.COMPLIANCE_A)
            b[i] *= 1.0 + c.bulk_modulus_pa * self._total(i, Stage.COMPLIANCE_B)
            leak[i] = self._total(i, Stage.FLOW_A) / a[i] - self._total(i, Stage.FLOW_B) / b[i]
        return OilColumns(a, b, self._leak.update(leak).copy())

    def signals(self, opening: FloatArray, steps: int = 1) -> FloatArray:
        """Signals (n,) to give for the openings wanted by eq. 24, after `steps` sample times."""
        slow = self._wanted.update(opening, steps).tolist()
        out = opening.copy()
        for i, inverse in enumerate(self._inverses):
            self._rows[i][sig.VALVE_SIGNAL] = float(opening[i])
            if inverse is not None:
                out[i] += inverse.signal(slow[i]) - slow[i]
        return out

    def openings(self, signal: FloatArray) -> FloatArray:
        """Openings (n,) that signals give, and which `columns` takes from here on."""
        out = np.array(
            [
                u if inverse is None else inverse.opening(u)
                for inverse, u in zip(self._inverses, signal.tolist(), strict=True)
            ]
        )
        for row, opening in zip(self._rows, out.tolist(), strict=True):
            row[sig.VALVE_SIGNAL] = opening
        return out

    def _total(self, axis: int, stage: Stage) -> float:
        return self._laws[axis].total(stage, self._rows[axis])


def _on_signal(one: ActiveEffect) -> bool:
    return any(term.stage is Stage.SIGNAL for term in one.terms)


def _pressure_delay_s(effects: Sequence[ActiveEffect]) -> float:
    """Mean delay of the two chambers."""
    return 0.5 * sum(float(a.parameters[0]) for a in effects if a.effect.name == "pressure_delay")


def _row(robot: Robot, cylinder: int) -> Signals:
    row = blank()
    for index, value in constant_signals(robot, cylinder, None).items():
        row[index] = value
    return row
