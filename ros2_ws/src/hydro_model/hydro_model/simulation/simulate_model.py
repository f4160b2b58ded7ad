"""The model of a robot with its effects: right-hand side, states at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.effects import ActiveEffect, Stage, resolve, with_changes
from hydro_model.effects.applied import changed_for_laws
from hydro_model.errors import SimulationError
from hydro_model.hydraulics import cylinder as geometry
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot

if TYPE_CHECKING:
    from hydro_model.simulation.simulate_arrays import ModelArrays, Work


class Model:
    """The right-hand side of a robot with its effects, for integrators of one's own.

    Parameters
    ----------
    robot : Robot
    measured_supply, measured_tank : bool
        The rail's pressure is given as an input: effects that would change it are left out.
    time_s : float
        Effects that change the robot (`Effect.change`) from a later time on are left out.

    Attributes
    ----------
    robot : Robot
        With its changes: masses, gravity and delays as the listed effects make them.
    active : tuple of ActiveEffect
        The effects that are laws. Those of instruments act on no machine
        (`hydro_model.effects.read_with`).

    Raises
    ------
    RobotError
        An effect does not resolve, or a cylinder has no valve.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        measured_supply: bool = False,
        measured_tank: bool = False,
        time_s: float = float("inf"),
    ) -> None:
        from hydro_model.simulation.simulate_arrays import model_arrays, new_work

        left_out = {Stage.SUPPLY} if measured_supply else set()
        left_out |= {Stage.TANK} if measured_tank else set()
        self.active: tuple[ActiveEffect, ...] = tuple(
            one for one in resolve(robot) if one.terms and one.terms[0].stage not in left_out
        )
        self.robot: Robot = changed_for_laws(with_changes(robot, time_s), self.active)
        self.arrays: ModelArrays = model_arrays(self.robot, self.active, robot)
        self.work: Work = new_work(self.robot, len(self.arrays.hinges))

    @property
    def state_size(self) -> int:
        """Entries of ``[q (n), qd (n), p_a (m), p_b (m), effect states]``."""
        return len(self.arrays.scale)

    def inputs(
        self, signals: ArrayLike, supply: float, tank: float, torque: ArrayLike | None = None
    ) -> FloatArray:
        """The input vector: normalised valve signals (m,), rails, joint torques (n,)."""
        extra = np.zeros(self.robot.dof) if torque is None else np.asarray(torque, dtype=float)
        return np.concatenate([np.asarray(signals, dtype=float), [supply, tank], extra])

    def rates(self, time_s: float, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Time derivative of the state, compiled.

        Parameters
        ----------
        time_s : float
        state : (state_size,) array
        inputs : (m + 2 + n,) array
            As `inputs` makes it.

        Returns
        -------
        (state_size,) array

        Raises
        ------
        SimulationError
            The mass matrix is not positive definite at this state.
        """
        from hydro_model.simulation.simulate_arrays import RATES
        from hydro_model.simulation.simulate_kernels import right_hand_side

        y = np.array(state, dtype=float)
        out = np.zeros_like(y)
        given = np.asarray(inputs, dtype=float)
        if not right_hand_side(self.arrays, self.work, time_s, given, y, out, RATES):
            raise SimulationError(
                f"robot {self.robot.name}: mass matrix not positive definite at"
                f" q = {y[: self.robot.dof]}"
            )
        return out

    def rest(self, q: ArrayLike, qd: ArrayLike, p0: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """A state with the effects' internal states at rest.

        Parameters
        ----------
        q, qd : (n,) array
        p0 : (m, 2) array
            Gauge pressures of chambers A and B, Pa.
        inputs : (m + 2 + n,) array

        Returns
        -------
        (state_size,) array
        """
        from hydro_model.simulation.simulate_arrays import REST
        from hydro_model.simulation.simulate_kernels import right_hand_side

        y = np.zeros(self.state_size)
        pressures = np.asarray(p0, dtype=float).T.ravel()
        known = np.concatenate([np.asarray(q, float), np.asarray(qd, float), pressures])
        y[: len(known)] = known
        given = np.asarray(inputs, dtype=float)
        right_hand_side(self.arrays, self.work, 0.0, given, y, np.zeros_like(y), REST)
        return y


def equilibrium_pressures(
    robot: Robot,
    q: ArrayLike,
    supply_pa: float | None = None,
    tank_pa: float | None = None,
) -> FloatArray:
    """Chamber pressures that hold the load at rest behind closed valves.

    The load fixes ``p_a A1 - p_b A2`` only. The other condition is that of equal leakage over
    the four edges of a closed valve: ``p_a + p_b = p_s + p_t``.

    Parameters
    ----------
    robot : Robot
    q : (n,) array
    supply_pa, tank_pa : float, optional
        Gauge; the robot's constants by default.

    Returns
    -------
    (m, 2) array
        Gauge pressures of chambers A and B, Pa.

    Raises
    ------
    SimulationError
        The load would need a pressure outside tank to supply.
    """
    p_s = robot.supply_pressure_pa if supply_pa is None else float(supply_pa)
    p_t = robot.tank_pressure_pa if tank_pa is None else float(tank_pa)
    position = shaped("q", q, (robot.dof,))
    still = np.zeros(robot.dof)
    torque = inverse_dynamics(robot, position, still, still)
    out = np.empty((len(robot.cylinders), 2))
    for row, cylinder in zip(out, robot.cylinders, strict=True):
        joint = robot.joint_index(cylinder.joint)
        force = torque[joint] / float(geometry.lever(cylinder, position[joint]))
        area = cylinder.area_a_m2 + cylinder.area_b_m2
        row[0] = (force + cylinder.area_b_m2 * (p_s + p_t)) / area
        row[1] = p_s + p_t - row[0]
        if not p_t <= row[0] <= p_s:
            raise SimulationError(
                f"robot {robot.name}: '{cylinder.name}' cannot hold {force:.0f} N at rest between"
                f" tank at {p_t:.4g} Pa and supply at {p_s:.4g} Pa"
            )
    return out


def shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """A contiguous array of the given shape; raises SimulationError naming it otherwise."""
    array = np.ascontiguousarray(value, dtype=float)
    if array.shape != shape:
        raise SimulationError(f"simulate: {name} should have shape {shape}, found {array.shape}")
    if not np.all(np.isfinite(array)):
        raise SimulationError(f"simulate: {name} holds values that are not finite")
    return array
