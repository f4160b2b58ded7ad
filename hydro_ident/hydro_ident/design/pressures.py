"""Chamber pressures and valve signals that a motion needs: the model run backwards.

Position, speed and piston force of every cylinder are given along the motion. Both chambers then
leave one pressure free: with f = p_a A1 - p_b A2 (eq. 9) the flow term of eqs. 14 and 15 gives the
valve signal, and chamber A's balance (eq. 10) carries its pressure on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.robot import Cylinder, FloatArray, Robot, Valve

#: Pressure difference below which an edge's flow is held, so that its root stays finite.
_LEAST_PA = 1.0e4


@dataclass(frozen=True, slots=True)
class Hydraulics:
    """What the hydraulics do along a motion.

    Attributes
    ----------
    p_a, p_b : (N, m) array
        Gauge, Pa.
    signal : (N, m) array
        Valve signal u; beyond +-1 the motion cannot be followed.
    unheld : (N, m) array
        The lower of both pressures where nothing held them between tank and supply: below
        absolute zero the oil cavitates.
    """

    p_a: FloatArray
    p_b: FloatArray
    signal: FloatArray
    unheld: FloatArray


def required_hydraulics(
    robot: Robot, step_s: float, q: FloatArray, qd: FloatArray, force: FloatArray
) -> Hydraulics:
    """Pressures and signals of every cylinder with a valve; NaN for the others.

    Parameters
    ----------
    robot : Robot
    step_s : float
    q, qd : (N, n) array
    force : (N, m) array
        Piston forces, N.

    Returns
    -------
    Hydraulics
    """
    shape = (len(q), len(robot.cylinders))
    p_a, p_b, signal, unheld = (np.full(shape, np.nan) for _ in range(4))
    valves = {valve.cylinder: valve for valve in robot.valves}
    for i, cylinder in enumerate(robot.cylinders):
        if cylinder.name not in valves or robot.supply_pressure_pa <= 0.0:
            continue
        j = robot.joint_index(cylinder.joint)
        x = np.asarray(stroke(cylinder, q[:, j]))
        speed = np.asarray(lever(cylinder, q[:, j])) * qd[:, j]
        rate = np.gradient(force[:, i], step_s)
        chamber = _Chambers(robot, cylinder, valves[cylinder.name], step_s)
        columns = chamber.run(x.tolist(), speed.tolist(), force[:, i].tolist(), rate.tolist())
        p_a[:, i], p_b[:, i], signal[:, i], unheld[:, i] = columns.T
    return Hydraulics(p_a, p_b, signal, unheld)


class _Chambers:
    """One cylinder and its valve; plain floats, since every step needs the one before."""

    def __init__(self, robot: Robot, cylinder: Cylinder, valve: Valve, step_s: float) -> None:
        self.a1, self.a2 = cylinder.area_a_m2, cylinder.area_b_m2
        self.bulk, self.stroke = cylinder.bulk_modulus_pa, cylinder.stroke_m
        self.p_s, self.p_t = robot.supply_pressure_pa, robot.tank_pressure_pa
        self.valve, self.step_s = valve, step_s

    def run(
        self, x: list[float], speed: list[float], force: list[float], rate: list[float]
    ) -> FloatArray:
        """Rows of p_a, p_b, u and the lower pressure that the same motion had unheld."""
        p_a = unheld = self._start(force[0])
        rows = np.empty((len(x), 4))
        for k, (at, v, f, fdot) in enumerate(zip(x, speed, force, rate, strict=True)):
            p_a = self._inside(p_a, f)
            u, after = self._step(at, v, f, fdot, p_a)
            rows[k] = p_a, self._other(p_a, f), u, min(unheld, self._other(unheld, f))
            # As long as nothing is held both are one.
            unheld = after if unheld == p_a else self._step(at, v, f, fdot, unheld)[1]
            p_a = after
        return rows

    def _other(self, p_a: float, force: float) -> float:
        """Chamber B's pressure (eq. 9)."""
        return (self.a1 * p_a - force) / self.a2

    def _step(
        self, x: float, v: float, force: float, fdot: float, p_a: float
    ) -> tuple[float, float]:
        """Signal, and chamber A's pressure a step later."""
        u, flow, slope = self._signal(x, v, fdot, p_a, self._other(p_a, force))
        stiffness = self.bulk / (self.a1 * x)
        # Implicit in the edge's own slope: near supply or tank the balance is stiff.
        change = stiffness * (flow - self.a1 * v) * self.step_s
        return u, p_a + change / (1.0 + stiffness * slope * self.step_s)

    def _start(self, force: float) -> float:
        """Chamber A halfway between the bounds that supply, tank and load set."""
        low, high = self._bounds(force)
        return 0.5 * (low + high)

    def _bounds(self, force: float) -> tuple[float, float]:
        """Where chamber A can be with both chambers between tank and supply."""
        low = max(self.p_t, (force + self.a2 * self.p_t) / self.a1)
        high = min(self.p_s, (force + self.a2 * self.p_s) / self.a1)
        return low, max(high, low)

    def _inside(self, p_a: float, force: float) -> float:
        low, high = self._bounds(force)
        return min(max(p_a, low), high)

    def _signal(
        self, x: float, v: float, fdot: float, p_a: float, p_b: float
    ) -> tuple[float, float, float]:
        """Signal (eqs. 15 and 24), flow into chamber A, and how the flow falls with p_a."""
        near, far = self.bulk / x, self.bulk / (self.stroke - x)
        wanted = fdot + (self.a1 * near + self.a2 * far) * v
        valve = self.valve
        if wanted >= 0.0:
            into, out = self.p_s - p_a, p_b - self.p_t
            c_a, c_b = valve.c_pa, valve.c_bt
        else:
            into, out = p_a - self.p_t, self.p_s - p_b
            c_a, c_b = valve.c_at, valve.c_pb
        root_a, root_b = math.sqrt(max(into, _LEAST_PA)), math.sqrt(max(out, _LEAST_PA))
        u = wanted / (c_a * root_a * near + c_b * root_b * far)
        flow = u * c_a * root_a
        return u, flow, abs(u) * c_a / (2.0 * root_a)
