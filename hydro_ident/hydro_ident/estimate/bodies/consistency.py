"""The convex problems behind physically consistent parameters.

With scaled parameters phi, the base parameters are ``A phi = b`` and body l can exist when its
matrix M_l(phi) is positive definite (`hydro_ident.estimate.bodies.pseudo_inertia`).

`widest` asks by a semidefinite programme how far inside all bodies can be at once: negative where
they cannot exist. `nearest` finds the base parameters closest in the metric of their covariance
with which they can, and its multipliers tell which bodies are in the way. Both are solved by
clarabel, an interior point solver. `centred` then minimises the distance to the reference bodies
with the base parameters held exactly: a smooth, strictly convex problem whose minimum Newton's
method finds to the last digits, so that nothing of the solver's tolerance is left in the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from hydro_ident.errors import IdentError
from hydro_ident.estimate.bodies.pseudo_inertia import Body
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray

#: Bodies are sought this far inside at most, in units of their size.
_DEEP_ENOUGH = 0.1
#: Pull towards the reference: it decides where nothing else does, and hardly moves the rest.
_PULL = 1.0e-9
#: Share of the largest multiplier from which a body counts as active.
_ACTIVE_SHARE = 0.01
_NEWTON_STEPS = 200
#: Weights of the start and of the reference, from the one to the other.
_STAGES = (
    *((1.0, 10.0**k) for k in range(-6, 1)),
    *((10.0**k, 1.0) for k in range(-1, -9, -1)),
    (0.0, 1.0),
)


def widest(
    bodies: Sequence[Body], a: FloatArray, b: FloatArray, reference: FloatArray
) -> tuple[FloatArray, float]:
    """Maximise the smallest eigenvalue of some bodies subject to ``A phi = b``.

    Parameters
    ----------
    bodies : sequence of Body
        Those that are asked to exist; others are left free.
    a : (p, N) array
    b : (p,) array
    reference : (N,) array

    Returns
    -------
    phi : (N,) array
    depth : float
        Smallest eigenvalue of the worst body, in units of its size; negative: no such bodies.

    Raises
    ------
    IdentError
        The solver gave up.
    """
    null = null_space(a)
    start = np.linalg.pinv(a) @ b
    count = null.shape[1]
    rows, offsets, cones = [], [], []
    for body in bodies:
        size = body.basis.shape[1]
        maps = np.tensordot(null[body.columns].T, body.basis, axes=1)
        rows.append(np.column_stack([-_svec(maps).T, _svec(np.eye(size)[None]).T]))
        offsets.append(_svec(body.matrix(start)[None])[0])
        cones.append(size)
    rows.append(np.append(np.zeros(count), 1.0)[None])
    offsets.append(np.array([_DEEP_ENOUGH]))
    weight = np.append(np.full(count, _PULL), 0.0)
    linear = np.append(-_PULL * (null.T @ (reference - start)), -1.0)
    x, _ = _solve(weight, linear, np.vstack(rows), np.concatenate(offsets), (0, cones, 1))
    return np.asarray(start + null @ x[:-1]), float(x[-1])


@dataclass(frozen=True, slots=True)
class Nearest:
    """The closest base parameters of bodies that can exist.

    Attributes
    ----------
    phi : (N,) array
    distance : float
        ``|W (A phi - b)|``, standard deviations.
    active : tuple of str
        Bodies at the border of existing, which keep the distance from being smaller.
    """

    phi: FloatArray
    distance: float
    active: tuple[str, ...]


def nearest(
    bodies: Sequence[Body],
    a: FloatArray,
    b: FloatArray,
    whiten: FloatArray,
    reference: FloatArray,
    margin: float,
    pull: float = _PULL,
) -> Nearest:
    """The consistent parameters whose base parameters are closest to b.

    Parameters
    ----------
    bodies : sequence of Body
    a : (p, N) array
    b : (p,) array
    whiten : (p, p) array
        W with ``W C W^T = 1`` for the covariance C of b.
    reference : (N,) array
    margin : float
        Smallest eigenvalue asked of each body, in units of its size.
    pull : float
        Weight of the distance from the reference, which keeps bodies from growing at will.

    Returns
    -------
    Nearest

    Raises
    ------
    IdentError
        The solver gave up.
    """
    count, size_b = a.shape[1], b.size
    # Unknowns are phi and the whitened distance, in a unit that keeps both of order 1.
    unit = max(1.0, float(np.linalg.norm(whiten @ (a @ reference - b))))
    rows = [np.hstack([whiten @ a / unit, -np.eye(size_b)])]
    offsets, cones = [whiten @ b / unit], []
    for body in bodies:
        size = body.basis.shape[1]
        block = np.zeros((size * (size + 1) // 2, count + size_b))
        block[:, body.columns] = -_svec(body.basis).T
        rows.append(block)
        offsets.append(-margin * _svec(np.eye(size)[None])[0])
        cones.append(size)
    weight = np.concatenate([np.full(count, pull), np.ones(size_b)])
    linear = np.concatenate([-pull * reference, np.zeros(size_b)])
    x, dual = _solve(weight, linear, np.vstack(rows), np.concatenate(offsets), (size_b, cones, 0))
    phi, at, pressures = x[:count], size_b, []
    for size in cones:
        length = size * (size + 1) // 2
        pressures.append(float(_svec(np.eye(size)[None])[0] @ dual[at : at + length]))
        at += length
    largest = max(pressures)
    active = tuple(
        body.name
        for body, pressure in zip(bodies, pressures, strict=True)
        if pressure >= _ACTIVE_SHARE * largest
    )
    return Nearest(phi, float(np.linalg.norm(whiten @ (a @ phi - b))), active)


def centred(bodies: Sequence[Body], a: FloatArray, b: FloatArray, start: FloatArray) -> FloatArray:
    """The bodies closest to their references among those with ``A phi = b``.

    Closest by the log-determinant divergence ``sum_l tr(R_l^-1 M_l) - log det(R_l^-1 M_l) - d``
    (the entropic metric of Lee, Wensing and Park, IEEE Transactions on Robotics 36, 2020), which
    depends neither on units nor on frames, and is infinite where a body stops to exist.

    Parameters
    ----------
    bodies : sequence of Body
        Whose columns are all of phi.
    a : (p, N) array
    b : (p,) array
    start : (N,) array
        With every body positive definite and ``A phi`` close to b.

    Returns
    -------
    (N,) array

    Raises
    ------
    IdentError
        The start is outside, or Newton's method did not settle.
    """
    null = null_space(a)
    base = np.linalg.pinv(a) @ b
    if not null.size:
        return np.asarray(base)
    z = null.T @ (start - base)
    maps = [np.tensordot(null[body.columns].T, body.basis, axes=1) for body in bodies]
    # The start is the closest point to itself: references move over from it by factors of ten,
    # because Newton's method creeps along the border of the set where it is sent far at once.
    first = [np.linalg.inv(body.matrix(start)) for body in bodies]
    last = [np.linalg.inv(body.reference) for body in bodies]
    for old, new in _STAGES:
        targets = [old * f + new * g for f, g in zip(first, last, strict=True)]
        z = _newton(bodies, (maps, targets), (base, null), z, old == 0.0)
    return np.asarray(base + null @ z)


def _newton(
    bodies: Sequence[Body],
    costs: tuple[Sequence[FloatArray], Sequence[FloatArray]],
    affine: tuple[FloatArray, FloatArray],
    z: FloatArray,
    to_the_end: bool,
) -> FloatArray:
    """Minimise ``sum_l tr(T_l M_l) - log det M_l`` over ``phi = base + null z``."""
    base, null = affine
    best = np.inf
    for _ in range(_NEWTON_STEPS):
        gradient, hessian = _slopes(bodies, costs, base + null @ z)
        size = np.sqrt(np.diag(hessian))
        step = -np.linalg.solve(hessian / np.outer(size, size), gradient / size) / size
        decrement = float(-gradient @ step)
        if not np.isfinite(decrement):
            break
        # Quadratic convergence ends where rounding begins: no smaller decrement is to be had.
        if decrement <= (1e-18 if to_the_end else 1e-2) or best <= decrement < 1e-9:
            return z + step
        best = min(best, decrement)
        # The damped step of self-concordant functions stays inside and always goes down.
        z = z + step * (1.0 if decrement < 0.06 else 1.0 / (1.0 + np.sqrt(decrement)))
    raise IdentError("the closest consistent parameters did not settle")


def divergence(body: Body, phi: FloatArray) -> float:
    """Log-determinant divergence of one body from its reference; infinite outside."""
    ratio = np.linalg.solve(body.reference, body.matrix(phi))
    try:
        np.linalg.cholesky(body.matrix(phi))
    except np.linalg.LinAlgError:
        return float("inf")
    return float(np.trace(ratio) - np.linalg.slogdet(ratio)[1] - body.reference.shape[0])


def _slopes(
    bodies: Sequence[Body],
    costs: tuple[Sequence[FloatArray], Sequence[FloatArray]],
    phi: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    count = costs[0][0].shape[0]
    gradient, hessian = np.zeros(count), np.zeros((count, count))
    for body, basis, target in zip(bodies, *costs, strict=True):
        inverse = np.linalg.inv(body.matrix(phi))
        gradient += np.tensordot(basis, target - inverse, axes=2)
        turned = inverse @ basis
        hessian += np.einsum("iab,jba->ij", turned, turned)
    return gradient, hessian


def null_space(a: FloatArray) -> FloatArray:
    """Orthonormal basis, as columns, of what A (of full row rank) maps to zero.

    `a` is the matrix.
    """
    return np.asarray(np.linalg.svd(a)[2][a.shape[0] :].T)


def _svec(matrices: FloatArray) -> FloatArray:
    """Upper triangles column by column, off-diagonal entries times sqrt(2): (k, d(d+1)/2)."""
    row, column = _triangle(matrices.shape[-1])
    return np.asarray(matrices[:, row, column] * np.where(row == column, 1.0, np.sqrt(2.0)))


def _triangle(size: int) -> tuple[IndexArray, IndexArray]:
    column, row = np.tril_indices(size)
    return row, column


def _solve(
    weight: FloatArray,
    linear: FloatArray,
    rows: FloatArray,
    offsets: FloatArray,
    cones: tuple[int, Sequence[int], int],
) -> tuple[FloatArray, FloatArray]:
    """Minimise ``x^T diag(weight) x / 2 + linear x`` with ``offsets - rows x`` in the cones.

    Cones are so many equalities, the sizes of semidefinite matrices, so many inequalities.
    """
    import clarabel  # type: ignore[import-untyped]

    equal, sizes, positive = cones
    kinds = [clarabel.ZeroConeT(equal)] if equal else []
    kinds += [clarabel.PSDTriangleConeT(size) for size in sizes]
    kinds += [clarabel.NonnegativeConeT(positive)] if positive else []
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # One thread and one factorisation: the same input gives the same answer, bit for bit.
    settings.max_threads, settings.direct_solve_method = 1, "qdldl"
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    solver = clarabel.DefaultSolver(
        sparse.diags_array(weight).tocsc(),
        linear,
        sparse.csc_array(rows),
        offsets,
        kinds,
        settings,
    )
    found = solver.solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        raise IdentError(f"the semidefinite programme ended with {found.status}")
    return np.array(found.x), np.array(found.z)
