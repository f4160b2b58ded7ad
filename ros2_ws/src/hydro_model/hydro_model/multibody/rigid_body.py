"""Rigid-body dynamics of a serial chain in 3D: one sample or a stack of them.

The recursions run compiled (`hydro_model.multibody.rigid_body_kernels`); the same equations,
readable and in numpy, are in `hydro_model.multibody.rigid_body_reference`.

Joint vectors have shape (n,) or (N, n): positions in rad or m, torques in N m or forces in N.
The inertial parameters are `robot.parameter_vector`: the links' standard parameters, then those
of the cylinders' barrels and rods, which move with the joints
(`hydro_model.multibody.closed_chain`). Forces and friction of cylinders are not part of it: they
enter through the lever arms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.errors import RobotError
from hydro_model.multibody import rigid_body_loops as loops
from hydro_model.multibody.chain_arrays import ChainArrays, chain_arrays, samples
from hydro_model.multibody.chain_kernels import SCRATCH
from hydro_model.robot import FloatArray, Robot


def inverse_dynamics(robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> FloatArray:
    """Joint torques of a motion, gravity included (eqs. 5 to 8, joint index corrected).

    Parameters
    ----------
    robot : Robot
    q, qd, qdd : (n,) or (N, n) array

    Returns
    -------
    (n,) or (N, n) array
        N m at revolute, N at prismatic joints.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    chain = chain_arrays(robot)
    (qs, qds, qdds), single = samples(robot, q, qd, qdd)
    out = np.empty_like(qs)
    loops.torques(qs, qds, qds, qdds, 0.0, *chain.frames, *chain.bodies, _scratch(chain), out)
    return out[0] if single else out


def required_torque(
    robot: Robot,
    q: ArrayLike,
    qd: ArrayLike,
    qd_r: ArrayLike,
    qdd_r: ArrayLike,
    k_v: float,
) -> FloatArray:
    """Joint torques of the required spatial forces (eq. 20, and eq. 22 without friction).

    Every link asks for ``Y(vdot_d, v) theta + k_v (v_d - v)`` in its own frame, the sum is
    carried inwards by eq. 7 and projected on the joint axes. ``v_d`` follows from `qd_r` by
    eq. 5, ``vdot_d`` is its derivative in the moving frames. With ``e = v_d - v`` the power of
    the difference to the actual torque is
    ``(qd_r - qd) . (tau_r - tau) = d/dt sum(e^T M e / 2) + k_v sum(e^T e)``. Barrels and rods
    add their own ``Y theta``, and their ``e^T M e / 2`` to the first sum, but no feedback.

    Parameters
    ----------
    robot : Robot
    q, qd : (n,) or (N, n) array
        Measured positions and velocities.
    qd_r, qdd_r : (n,) or (N, n) array
        Required velocities and accelerations.
    k_v : float
        Multiplies all six components of ``v_d - v``: N m s/rad on the three angular ones,
        N s/m on the three linear ones (the paper states one number and one unit).

    Returns
    -------
    (n,) or (N, n) array
        N m at revolute, N at prismatic joints.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    chain = chain_arrays(robot)
    (qs, qds, qdrs, qddrs), single = samples(robot, q, qd, qd_r, qdd_r)
    out = np.empty_like(qs)
    gain = float(k_v)
    loops.torques(qs, qds, qdrs, qddrs, gain, *chain.frames, *chain.bodies, _scratch(chain), out)
    return out[0] if single else out


def regressor(robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> FloatArray:
    """Joint torque regressor: inverse dynamics as a matrix on the parameters (eqs. 18 and 29).

    Parameters
    ----------
    robot : Robot
    q, qd, qdd : (n,) or (N, n) array

    Returns
    -------
    (n, p) or (N, n, p) array
        Columns in the order of `robot.parameter_names`;
        ``regressor @ robot.parameter_vector`` is `inverse_dynamics`.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    chain = chain_arrays(robot)
    (qs, qds, qdds), single = samples(robot, q, qd, qdd)
    out = np.empty((*qs.shape, len(robot.parameter_names)))
    loops.regressors(
        qs, qds, qdds, *chain.frames, chain.gravity_m_s2, chain.parts, _scratch(chain), out
    )
    return out[0] if single else out


def mass_matrix(robot: Robot, q: ArrayLike) -> FloatArray:
    """Joint-space mass matrix.

    Parameters
    ----------
    robot : Robot
    q : (n,) or (N, n) array

    Returns
    -------
    (n, n) or (N, n, n) array
        Symmetric; positive definite where the links' parameters are physical.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    chain = chain_arrays(robot)
    (qs,), single = samples(robot, q)
    out = np.empty((*qs.shape, robot.dof))
    loops.masses(qs, *chain.frames, chain.theta, chain.parts, _scratch(chain), out)
    return out[0] if single else out


def forward_dynamics(robot: Robot, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> FloatArray:
    """Joint accelerations under given torques, ``M(q)^-1 (tau - h(q, qd))``.

    Parameters
    ----------
    robot : Robot
    q, qd, tau : (n,) or (N, n) array

    Returns
    -------
    (n,) or (N, n) array
        rad/s^2 or m/s^2.

    Raises
    ------
    RobotError
        A shape does not fit the robot, an input is not finite, or the parameters give a mass
        matrix that is not positive definite.
    """
    chain = chain_arrays(robot)
    (qs, qds, taus), single = samples(robot, q, qd, tau)
    out = np.empty_like(qs)
    n = robot.dof
    memory = (_scratch(chain), np.empty((n, n)), np.empty(n))
    bad = loops.accelerations(qs, qds, taus, *chain.frames, *chain.bodies, *memory, out)
    if bad >= 0:
        raise RobotError(
            f"robot {robot.name}: expected finite inputs and a positive definite mass matrix,"
            f" found otherwise at q = {np.array2string(qs[bad], precision=4)}"
        )
    return out[0] if single else out


def kinetic_energy(robot: Robot, q: ArrayLike, qd: ArrayLike) -> FloatArray:
    """Kinetic energy of links, barrels and rods in J, ``qd^T M(q) qd / 2``.

    Parameters
    ----------
    robot : Robot
    q, qd : (n,) or (N, n) array

    Returns
    -------
    () or (N,) array

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    (qs, qds), single = samples(robot, q, qd)
    energy = 0.5 * np.einsum("ki,kij,kj->k", qds, mass_matrix(robot, qs), qds)
    return np.asarray(energy[0] if single else energy)


def potential_energy(robot: Robot, q: ArrayLike) -> FloatArray:
    """Potential energy of links, barrels and rods in J, zero at the base frame's origin.

    With a model file's base parameters it is right up to a constant, as masses that gravity
    never shows on a joint are not in it.

    Parameters
    ----------
    robot : Robot
    q : (n,) or (N, n) array

    Returns
    -------
    () or (N,) array

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    chain = chain_arrays(robot)
    (qs,), single = samples(robot, q)
    out = np.empty(qs.shape[0])
    loops.potentials(qs, *chain.frames, *chain.bodies, _scratch(chain), out)
    return np.asarray(out[0] if single else out)


def _scratch(chain: ChainArrays) -> FloatArray:
    """Working memory of the kernels."""
    return np.empty((len(chain.axis) + len(chain.parts), SCRATCH))
