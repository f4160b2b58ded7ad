"""Base inertial parameters of a serial chain and how standard parameters regroup into them.

The recursive parameter nullspace algorithm of Wensing, Niemeyer and Slotine (arXiv 1711.03896,
the paper's reference 14): from the geometry alone, without sampling motions. Changes of the
parameters that no joint torque shows are sequences of transfers of inertia across the joints, so
three small subspaces are carried from the base outwards, per link:

- the span of the velocities, and of the direction of gravity, that the link can see;
- the functionals of the link's ten parameters that the joints up to it observe;
- the transfers: parameters that can move from the link to its parent at any joint position.

Velocities depend on a revolute joint's position as trigonometric polynomials of degree 1 and
inertias as ones of degree 2 (plain polynomials of these degrees for a prismatic joint): values at
3 and 5 (2 and 3) positions hold all of them, which replaces the powers of the algorithm's
observability matrices and stays well scaled.

The leading parameter of each combination is then chosen among those by pivoting, so that no
coefficient grows large however nearly the axes align.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro_model.multibody.closed_chain import with_parameters
from hydro_model.multibody.part_regrouping import with_parts
from hydro_model.multibody.payload_parameters import PAYLOAD_NAMES, inertia_map, payload_effect
from hydro_model.multibody.spatial import axis_rotation, body_regressor, motion_transform
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray, Joint, Robot

_SIZE = len(STANDARD_PARAMETERS)
#: Power of the length unit in each standard parameter's unit.
_LENGTH_POWER = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
#: Parameters in the order in which a link gives them away to its parent, all else being equal:
#: mass and moments across the joint go, as in the usual tables of base parameters.
_GIVEN_AWAY = (0, 3, 2, 1, 9, 8, 7, 6, 5, 4)
#: A pivot is good enough from this share of the largest one.
_PIVOT_SHARE = 0.5
#: Above this regrouping coefficient (SI units) leading and eliminated parameter change places.
_COEFFICIENT_LIMIT = 300.0
_NEGLIGIBLE = 1.0e-11


@dataclass(frozen=True, slots=True, eq=False)
class BaseMap:
    """The base parameters as combinations of the standard ones, ``theta_b = K theta``.

    Attributes
    ----------
    names : tuple of str
        The p leading standard parameters, in column order.
    leading : (p,) int array
        Their columns. The columns of a regressor at `leading` are the base regressor:
        ``Y @ theta = Y[..., leading] @ (combination @ theta)``.
    combination : (p, c) array
        K over all c = 10 n + 6 k columns. The leading parameter's coefficient is 1.
    standard_names : tuple of str
        The names of the columns, `Robot.parameter_names`.
    link_count : int
        Number of base parameters that a link's parameter leads; they come first.
    """

    names: tuple[str, ...]
    leading: NDArray[np.intp]
    combination: FloatArray
    standard_names: tuple[str, ...]
    link_count: int

    @property
    def of_links(self) -> BaseMap:
        """The base parameters that a link's parameter leads, alone."""
        n = self.link_count
        return replace(
            self,
            names=self.names[:n],
            leading=self.leading[:n],
            combination=self.combination[:n],
        )

    def coefficients(self, index: int) -> dict[str, float]:
        """Coefficients of base parameter `index` by standard name, the leading one first.

        Rounded to 12 digits, which the rounding errors of `combination` do not reach.
        """
        row = self.combination[index]
        first = int(self.leading[index])
        rest = [int(k) for k in np.flatnonzero(row) if k != first]
        return {self.standard_names[k]: float(f"{row[k]:.12g}") for k in [first, *rest]}

    def readable(self, index: int) -> str:
        """Base parameter `index` as a sum, such as `lift_link.mcx + 1.6 tilt_link.mass`."""
        text = ""
        for name, value in self.coefficients(index).items():
            sign = "-" if value < 0.0 else "+"
            size = f"{abs(value):.6g}"
            factor = "" if size == "1" else f"{size} "
            text += f" {sign} {factor}{name}" if text else f"{factor}{name}"
        return text


def leading_value(
    name: str, value: float, combination: Mapping[str, float], given: Mapping[str, float]
) -> float:
    """The leading standard parameter with which a base parameter has a value.

    Parameters
    ----------
    name : str
        Of the leading parameter.
    value : float
        Of the base parameter.
    combination : mapping of str to float
        Coefficients of standard parameters, the leading one's 1.
    given : mapping of str to float
        Standard parameters; the leading one is not used.
    """
    rest = math.fsum(c * given[other] for other, c in combination.items() if other != name)
    return value - rest


def with_base(robot: Robot, base: BaseMap, values: FloatArray) -> Robot:
    """The robot whose links have these base parameters, all else about them as it was.

    The leading ones take up the difference; what no torque shows stays what was given, such as
    the datasheet's: once an effect turns gravity it shows.

    Parameters
    ----------
    robot : Robot
    base : BaseMap
        Of it.
    values : (p,) array
        In SI units.
    """
    vector = np.array(robot.parameter_vector, dtype=np.float64)
    # Barrels and rods are in the base parameters where these have them.
    vector[robot.link_inertia.size :] = 0.0
    given = dict(zip(base.standard_names, vector.tolist(), strict=True))
    for i, name in enumerate(base.names):
        at = base.leading[i]
        vector[at] = leading_value(name, float(values[i]), base.coefficients(i), given)
    return with_parameters(robot, vector)


def base_map(robot: Robot, tolerance: float = 1.0e-12, *, payload: bool = False) -> BaseMap:
    """Base parameters of a robot on a fixed base, from its geometry and gravity's direction.

    Parameters
    ----------
    robot : Robot
        Its inertia is not used.
    tolerance : float
        A signal below this share of the largest one counts as absent, as in a numerical rank.
        Axes tilted against one another by e give signals of e and e^2: the default tells apart
        what a URDF's rounding (1.5708 for a right angle) has tilted; 1e-4 does not.
    payload : bool
        Add the ten `PAYLOAD_NAMES` of a body fixed to the tip, which regroup with the last link.

    Returns
    -------
    BaseMap
        Parameters in column order: the links' from the base outwards, then those of barrels and
        rods (`hydro_model.multibody.part_regrouping`).
    """
    leading, combination = _links_map(robot, tolerance)
    if robot.closed_chains:
        leading, combination = with_parts(robot, leading, combination)
    names = robot.parameter_names
    if payload:
        combination = np.hstack([combination, payload_effect(robot, combination)])
        names = (*names, *PAYLOAD_NAMES)
    of_links = int(np.sum(leading < _SIZE * robot.dof))
    return BaseMap(tuple(names[k] for k in leading), leading, combination, names, of_links)


def _links_map(robot: Robot, tolerance: float) -> tuple[NDArray[np.intp], FloatArray]:
    """Leading columns and K of the links alone."""
    length = longest_link_m(robot)
    transfers = _transfers(robot, length, tolerance)
    scale = np.tile(length**_LENGTH_POWER, robot.dof)
    blocks = _null_basis(robot, transfers, length) * scale[:, None]
    given = [_SIZE * i + k for i, basis in enumerate(transfers) for k in _eliminated(basis)]
    given, weights = _bounded(blocks, given)
    leading = np.setdiff1d(np.arange(_SIZE * robot.dof), given)
    combination = np.zeros((leading.size, _SIZE * robot.dof))
    combination[np.arange(leading.size), leading] = 1.0
    combination[:, given] = weights
    return leading, combination


def longest_link_m(robot: Robot) -> float:
    """The longest link, m: a unit of length in which inertial parameters are of one size.

    1 m where no link has a length.

    Parameters
    ----------
    robot : Robot
    """
    links = [float(np.linalg.norm(joint.translation_m)) for joint in robot.joints]
    return max([*links, float(np.linalg.norm(robot.tip_offset_m))]) or 1.0


def _transfers(robot: Robot, length: float, tolerance: float) -> list[FloatArray]:
    """Per joint, an orthonormal basis (10, d) of the transfers across it, length units.

    The spans are carried as triangular factors, not as orthonormal bases: a signal that a tilt
    of 1e-3 rad makes stays that small, and with it the rounding errors in it, so that what is
    decided here is the rank that a regressor would show.
    """
    gravity = np.concatenate([np.zeros(3), robot.gravity_m_s2])
    attainable = gravity[None, :] / (np.linalg.norm(gravity) or 1.0)
    observed = np.zeros((0, _SIZE))
    transfers = []
    for joint in robot.joints:
        s = _axis_vector(joint)
        seen = [attainable @ _transform(joint, q, length).T for q in _positions(joint, 1)]
        attainable = _triangular([s[None, :], *seen])
        # Own torque: s^T M(theta) v for every attainable v, gravity's direction among them.
        own = s @ body_regressor(attainable, np.zeros_like(attainable))
        carried = [
            observed @ inertia_map(_transform(joint, q, length)) for q in _positions(joint, 2)
        ]
        changes = [rows - carried[0] for rows in carried[1:]]
        transfers.append(_null_space(np.vstack([own, *changes]), tolerance))
        observed = _triangular([own, *carried])
    return transfers


def _axis_vector(joint: Joint) -> FloatArray:
    still = np.zeros(3)
    return np.concatenate([still, joint.axis] if joint.prismatic else [joint.axis, still])


def _positions(joint: Joint, degree: int) -> FloatArray:
    """Positions whose values determine a polynomial (prismatic) or trigonometric one."""
    if joint.prismatic:
        return np.arange(degree + 1.0)
    count = 2 * degree + 1
    return 2.0 * np.pi * np.arange(count) / count


def _transform(joint: Joint, q: float, length: float) -> FloatArray:
    """X from the parent to the child frame in length units (prismatic q in them too)."""
    shift = joint.translation_m / length
    if joint.prismatic:
        return motion_transform(joint.rotation, shift + q * joint.rotation @ joint.axis)
    turned = joint.rotation @ axis_rotation(joint.axis, np.asarray(q))
    return motion_transform(turned, shift)


def _null_basis(robot: Robot, transfers: list[FloatArray], length: float) -> FloatArray:
    """All undetectable changes (10 n, d): what a link gives away, its parent takes."""
    columns = []
    for i, (joint, basis) in enumerate(zip(robot.joints, transfers, strict=True)):
        block = np.zeros((robot.dof, _SIZE, basis.shape[1]))
        block[i] = basis
        if i > 0:
            block[i - 1] = -inertia_map(_transform(joint, 0.0, length)) @ basis
        columns.append(block.reshape(_SIZE * robot.dof, -1))
    return np.hstack(columns)


def _triangular(rows: list[FloatArray]) -> FloatArray:
    """The same span, and the same weights in it, in as few rows as it has columns."""
    return np.asarray(np.linalg.qr(np.vstack(rows))[1], dtype=np.float64)


def _null_space(rows: FloatArray, tolerance: float) -> FloatArray:
    """Orthonormal basis, as columns, of what some rows map to zero."""
    _, values, basis = np.linalg.svd(rows)
    rank = int(np.sum(values > tolerance * values[0]))
    return np.asarray(basis[rank:].T)


def _eliminated(basis: FloatArray) -> list[int]:
    """As many of the ten parameters as the basis (10, d) has columns, its rows independent.

    Rows are pivoted by what is left of them after removing the rows already chosen; among
    those close to the largest the one that tables usually eliminate goes first.
    """
    left, chosen = basis.copy(), []
    for _ in range(basis.shape[1]):
        norms = np.linalg.norm(left, axis=1)
        enough = _PIVOT_SHARE * norms.max()
        pivot = next(k for k in _GIVEN_AWAY if norms[k] >= enough)
        direction = left[pivot] / norms[pivot]
        left = left - np.outer(left @ direction, direction)
        chosen.append(pivot)
    return chosen


def _bounded(null_basis: FloatArray, given: list[int]) -> tuple[list[int], FloatArray]:
    """Eliminated parameters and their coefficients in the base parameters, kept bounded.

    With the null basis' rows split into leading L and eliminated E, ``theta_L + W theta_E`` is
    unchanged by it for ``W = -N_L N_E^-1``. Where an entry of W exceeds the limit the pair
    changes places: that multiplies the determinant of N_E by the entry, so it ends.
    """
    given = list(given)
    while True:
        leading = np.setdiff1d(np.arange(null_basis.shape[0]), given)
        solved = np.linalg.solve(null_basis[given].T, null_basis[leading].T)
        weights = np.asarray(-solved.T, dtype=np.float64)
        weights[np.abs(weights) < _NEGLIGIBLE] = 0.0
        if weights.size == 0 or np.abs(weights).max() <= _COEFFICIENT_LIMIT:
            return given, weights
        row, column = np.unravel_index(np.abs(weights).argmax(), weights.shape)
        given[int(column)] = int(leading[row])
