"""Compensation of the listed effects as one reads it: plain Python, sample by sample.

The compiled kernels of `hydro_control.compensation.listed_kernels`, which
`hydro_control.compensation.compensation` calls, are tested against this.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_control.compensation.compensation import (
    SHAPING_S,
    SMALLEST_SCALE_M_S,
    Motion,
    inverses_of,
)
from hydro_control.compensation.listed_arrays import signals_at_first
from hydro_control.compensation.listed_kernels import FLOW_WEIGHT
from hydro_control.compensation.listed_laws import ListedLaws
from hydro_control.state.axes import Axis
from hydro_control.state.filters import Ewma, alpha_for
from hydro_control.state.oil_columns import OilColumns
from hydro_model.effects import ActiveEffect, Stage
from hydro_model.effects import signals as sig
from hydro_model.effects.rows import other_joint
from hydro_model.robot import FloatArray, Robot


class ReadableCompensation:
    """As `hydro_control.compensation.compensation.Compensation`: its parameters and methods.

    Parameters
    ----------
    robot : Robot
    effects : sequence of ActiveEffect
    axes : sequence of Axis
    dt_s : float
    smallest_scale_m_s : float
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
        own = [tuple(a for a in effects if a.cylinder == x.cylinder_index) for x in axes]
        self._laws = [ListedLaws(one, smallest_scale_m_s) for one in own]
        self._inverses = inverses_of(effects, axes)
        self._others = [other_joint(robot, robot.joint_index(a.joint.name)) for a in axes]
        self._rows = signals_at_first(robot, axes).tolist()
        self._wanted = Ewma(alpha_for(SHAPING_S, dt_s))
        self._leak = Ewma(FLOW_WEIGHT)

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

    def _total(self, axis: int, stage: Stage) -> float:
        return self._laws[axis].total(stage, self._rows[axis])
