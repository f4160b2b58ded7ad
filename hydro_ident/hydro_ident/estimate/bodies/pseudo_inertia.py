"""Bodies as symmetric matrices that are positive definite exactly when the body can exist.

The ten standard parameters of a link (eq. 28) are the moments of a mass distribution; gathered in
the 4 x 4 pseudo-inertia

    J = [[tr(I)/2 1 - I, m c], [(m c)^T, m]]

they belong to some distribution of positive density exactly when J is positive definite (Wensing,
Kim and Slotine, IEEE Robotics and Automation Letters 3, 2018). It is linear in the parameters, so
that consistency is a linear matrix inequality. A body that moves in a plane, such as a barrel or
a rod (mass, first moments, one inertia i about its pin), has ``[[i 1, m c], [(m c)^T, m]]``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro_ident.errors import IdentError
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray

#: Smallest eigenvalue of a reference body, in units of its size: keeps a point mass invertible.
_REFERENCE_FLOOR = 1.0e-4
#: Of a body without given values: radius of gyration in units of the machine's length.
_GUESSED_RADIUS = 0.3
_LENGTH_POWER = {"mass": 0, "mcx": 1, "mcy": 1, "mcz": 1}


@dataclass(frozen=True, slots=True)
class Body:
    """A body and the matrix that decides whether it can exist, in units of its own size.

    Attributes
    ----------
    name : str
    columns : (k,) int array
        Of its parameters in the list of standard parameters.
    scale : (k,) array
        Unit of each parameter: the body's mass times powers of its radius.
    basis : (k, d, d) array
        ``M = sum_k phi_k basis_k`` for parameters phi in those units.
    reference : (d, d) array
        Positive definite M of the given values.
    given : bool
        The given values were positive definite themselves; otherwise `reference` is the nearest
        such matrix, or a guess where nothing was given.
    """

    name: str
    columns: NDArray[np.intp]
    scale: FloatArray
    basis: FloatArray
    reference: FloatArray
    given: bool

    @property
    def spatial(self) -> bool:
        """A link with all ten parameters, not a barrel or rod."""
        return self.columns.size == len(STANDARD_PARAMETERS)

    def matrix(self, phi: FloatArray) -> FloatArray:
        """M of all scaled parameters phi, shape (d, d)."""
        return np.asarray(np.tensordot(phi[self.columns], self.basis, axes=1))


def bodies_of(names: Sequence[str], values: FloatArray, length_m: float) -> tuple[Body, ...]:
    """The bodies among a list of standard parameters.

    Parameters
    ----------
    names : sequence of str
        `<body>.<parameter>`; the ten of a link, or mass, first moments and one inertia.
    values : (N,) array
        As given (CAD, datasheet); zeros where nothing is known.
    length_m : float
        Of the machine, for bodies without given values.

    Returns
    -------
    tuple of Body

    Raises
    ------
    IdentError
        A body's parameters are neither of the two sets.
    """
    columns: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        columns.setdefault(name.rsplit(".", 1)[0], []).append(column)
    masses = {
        body: abs(float(values[k]))
        for body, at in columns.items()
        for k in at
        if names[k] == f"{body}.mass"
    }
    known = [m for m in masses.values() if m > 0.0]
    typical = float(np.mean(known)) if known else 0.0
    return tuple(
        _body(body, at, [names[k].rsplit(".", 1)[1] for k in at], values, (typical, length_m))
        for body, at in columns.items()
    )


def _body(
    name: str,
    columns: Sequence[int],
    kinds: Sequence[str],
    values: FloatArray,
    typical: tuple[float, float],
) -> Body:
    basis = _basis(name, kinds)
    own = dict(zip(kinds, values[list(columns)], strict=True))
    mass, radius = _size(own, typical)
    powers = np.array([_LENGTH_POWER.get(kind, 2) for kind in kinds])
    scale = mass * radius**powers
    reference, given = _reference(basis, values[list(columns)] / scale, own["mass"] > 0.0)
    return Body(name, np.array(columns, dtype=np.intp), scale, basis, reference, given)


def _basis(name: str, kinds: Sequence[str]) -> FloatArray:
    """One symmetric matrix per parameter."""
    moments = [k for k in kinds if k.startswith("mc")]
    inertias = [k for k in kinds if k not in ("mass", *moments)]
    spatial = sorted(kinds) == sorted(STANDARD_PARAMETERS)
    if "mass" not in kinds or not (spatial or len(inertias) == 1):
        raise IdentError(
            f"body '{name}': expected the parameters {', '.join(STANDARD_PARAMETERS)}, or mass,"
            f" first moments and one inertia, found {', '.join(kinds)}"
        )
    order = ["mcx", "mcy", "mcz"] if spatial else moments
    size = len(order) + 1
    basis = np.zeros((len(kinds), size, size))
    for matrix, kind in zip(basis, kinds, strict=True):
        if kind == "mass":
            matrix[-1, -1] = 1.0
        elif kind in order:
            matrix[order.index(kind), -1] = matrix[-1, order.index(kind)] = 1.0
        elif spatial:
            row, column = ("xyz".index(axis) for axis in kind[1:])
            inertia = np.zeros((3, 3))
            inertia[row, column] = inertia[column, row] = 1.0
            matrix[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
        else:
            matrix[:-1, :-1] = np.eye(size - 1)
    return basis


def _size(own: Mapping[str, float], typical: tuple[float, float]) -> tuple[float, float]:
    """Mass and radius that make the body's parameters numbers of order 1."""
    mass = abs(own["mass"])
    if mass == 0.0:
        return typical[0] or 1.0, typical[1]
    arm = np.linalg.norm([v for k, v in own.items() if k.startswith("mc")]) / mass
    inertias = [abs(v) for k, v in own.items() if k in ("ixx", "iyy", "izz")]
    return mass, max(float(arm), float(np.sqrt(max(inertias) / mass)), 1e-2 * typical[1])


def _reference(basis: FloatArray, phi: FloatArray, known: bool) -> tuple[FloatArray, bool]:
    size = basis.shape[1]
    if not known:
        return np.diag([*[_GUESSED_RADIUS**2] * (size - 1), 1.0]), False
    matrix = np.tensordot(phi, basis, axes=1)
    values, vectors = np.linalg.eigh(matrix)
    if values[0] >= _REFERENCE_FLOOR:
        return np.asarray(matrix), True
    lifted = np.maximum(values, _REFERENCE_FLOOR)
    return np.asarray(vectors * lifted @ vectors.T), False
