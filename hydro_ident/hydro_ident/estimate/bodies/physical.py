"""Physically consistent standard parameters that reproduce identified base parameters.

The base parameters fix combinations of the standard ones; the rest is free as far as motion goes.
Of all standard parameters that reproduce the base parameters, those are given whose bodies can
exist (positive definite pseudo-inertia) and are closest to the values given for them (CAD). Where
no such bodies exist, the bodies that cannot are named with the proof's size in standard
deviations, and the closest base parameters that could exist are shown beside the identified ones,
which they never replace.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.bodies.consistency import Nearest, centred, divergence, nearest, widest
from hydro_ident.estimate.bodies.pseudo_inertia import Body, bodies_of
from hydro_model.robot import FloatArray

#: Bodies exist when this far inside, in units of their size: the solver's accuracy and a margin.
DEPTH = 1.0e-7
#: Depth asked of the closest consistent base parameters.
MARGIN = 1.0e-6
#: Below this, in units of the bodies, a parameter is the rounding of a zero.
_ROUNDING = 1.0e-13
#: Bodies are also named together where that adds so much to what each alone is off.
_TOGETHER_FACTOR = 1.5
#: A body alone may be of any size: its distance is a bound, not a proposal.
_PULL_ALONE = 1.0e-12
#: A base parameter is named from this share of the largest shift in standard deviations.
_NAMED_SHARE, _NAMED_MOST = 0.1, 4
#: Covariance is never taken below this share of a base parameter in the metric of distances.
_STD_FLOOR = 1.0e-7


@dataclass(frozen=True, slots=True)
class BaseEstimate:
    """Base parameters as identified.

    Attributes
    ----------
    names : tuple of str
    combination : (p, N) array
        Over the standard parameters.
    values : (p,) array
    covariance : (p, p) array
        Zero where nothing is known of it.
    """

    names: tuple[str, ...]
    combination: FloatArray
    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True)
class ConsistentBody:
    """A body that can exist.

    Attributes
    ----------
    name : str
    parameters : mapping of str to float
        Standard parameters: of a link, in its frame and about its origin.
    divergence : float
        Log-determinant divergence from the given body; 0: the same.
    depth : float
        Smallest eigenvalue of its matrix, in units of the given body's size.
    given : bool
        The values that it was kept close to were consistent themselves.
    """

    name: str
    parameters: dict[str, float]
    divergence: float
    depth: float
    given: bool


@dataclass(frozen=True, slots=True)
class Inconsistency:
    """Bodies of which no consistent values reproduce the base parameters.

    Attributes
    ----------
    bodies : tuple of str
        One that cannot exist whatever the others are, or several that cannot all at once.
    standard_deviations : float
        From the base parameters to the closest with which these bodies, the others left free,
        could exist; infinite without a covariance.
    base_parameters : tuple of str
        Those that would have to move, the one that moves most first.
    """

    bodies: tuple[str, ...]
    standard_deviations: float
    base_parameters: tuple[str, ...]

    @property
    def text(self) -> str:
        """A line for the report."""
        who, first = " and ".join(self.bodies), self.base_parameters[:_NAMED_MOST]
        more = len(self.base_parameters) - len(first)
        which = ", ".join(first) + (f" and {more} more" if more else "")
        together = " together" if len(self.bodies) > 1 else ""
        size = self.standard_deviations
        far = f", {told_distance(size)} from the closest" if math.isfinite(size) else ""
        return f"no physically consistent {who}{together} has the identified {which}{far}"


def told_distance(deviations: float) -> str:
    """A distance in words.

    Parameters
    ----------
    deviations : float
    """
    size = f"{deviations:.1f}"
    return f"{'less than 0.1' if size == '0.0' else size} standard deviations"


@dataclass(frozen=True, slots=True)
class PhysicalParameters:
    """Consistent standard parameters, and whether they reproduce the base parameters.

    Attributes
    ----------
    feasible : bool
    bodies : tuple of ConsistentBody
        Where not feasible: of the closest consistent base parameters.
    base : tuple of str
    identified, closest : (p,) array
        Base parameters identified, and those of `bodies`: the same where feasible.
    distance : float
        Between the two in the metric of the covariance, standard deviations.
    problems : tuple of Inconsistency
    """

    feasible: bool
    bodies: tuple[ConsistentBody, ...]
    base: tuple[str, ...]
    identified: FloatArray
    closest: FloatArray
    distance: float
    problems: tuple[Inconsistency, ...]


def physical_parameters(
    names: Sequence[str], given: FloatArray, estimate: BaseEstimate, length_m: float
) -> PhysicalParameters:
    """Consistent standard parameters closest to the given ones.

    Parameters
    ----------
    names : sequence of str
        The N standard parameters, `<body>.<parameter>`.
    given : (N,) array
        CAD or datasheet values; zeros where there are none.
    estimate : BaseEstimate
    length_m : float
        Of the machine, for bodies without given values.

    Returns
    -------
    PhysicalParameters

    Raises
    ------
    IdentError
        A body's parameters are not known as such, or the solver gave up.
    """
    bodies = bodies_of(names, given, length_m)
    scaled = _Scaled.of(bodies, estimate, len(names), given)
    start, depth = widest(bodies, scaled.a, scaled.b, scaled.reference)
    feasible = depth >= DEPTH
    b, distance = scaled.b, 0.0
    problems: tuple[Inconsistency, ...] = ()
    if not feasible:
        found = scaled.nearest(bodies, estimate.covariance)
        problems = _problems(bodies, scaled, estimate, found)
        start, distance, b = found.phi, found.distance, scaled.a @ found.phi
    phi = centred(bodies, scaled.a, b, start)
    phi[np.abs(phi) < _ROUNDING] = 0.0
    theta = phi * scaled.scale
    closest = estimate.combination @ theta if not feasible else estimate.values
    return PhysicalParameters(
        feasible=feasible,
        bodies=tuple(_consistent(body, names, phi, theta) for body in bodies),
        base=estimate.names,
        identified=estimate.values,
        closest=np.asarray(closest),
        distance=distance,
        problems=problems,
    )


@dataclass(frozen=True, slots=True)
class _Scaled:
    """The base parameter equations in units of the bodies: rows of ``a phi = b`` of length 1."""

    scale: FloatArray
    norms: FloatArray
    a: FloatArray
    b: FloatArray
    reference: FloatArray

    @staticmethod
    def of(
        bodies: Sequence[Body], estimate: BaseEstimate, count: int, given: FloatArray
    ) -> _Scaled:
        scale = np.ones(count)
        reference = np.zeros(count)
        for body in bodies:
            scale[body.columns] = body.scale
            reference[body.columns] = np.linalg.lstsq(
                body.basis.reshape(body.columns.size, -1).T, body.reference.ravel(), rcond=None
            )[0]
        a = estimate.combination * scale
        norms = np.linalg.norm(a, axis=1)
        return _Scaled(scale, norms, a / norms[:, None], estimate.values / norms, reference)

    def whiten(self, covariance: FloatArray) -> FloatArray:
        """W with ``W C W^T = 1`` for the covariance of b, bounded where it vanishes."""
        own = covariance / np.outer(self.norms, self.norms)
        values, vectors = np.linalg.eigh(0.5 * (own + own.T))
        return np.asarray((vectors / np.sqrt(np.maximum(values, 0.0) + self.floor**2)).T)

    @property
    def floor(self) -> float:
        """Least deviation of b, for base parameters that are taken as exact."""
        return _STD_FLOOR * max(1.0, float(np.abs(self.b).max()))

    def exist(self, bodies: Sequence[Body]) -> bool:
        """Whether some bodies can exist, the others left free."""
        return widest(bodies, self.a, self.b, self.reference)[1] >= DEPTH

    def nearest(
        self, bodies: Sequence[Body], covariance: FloatArray, pull: float = 1.0e-9
    ) -> Nearest:
        """The closest base parameters with which some bodies can exist."""
        whiten = self.whiten(covariance)
        return nearest(bodies, self.a, self.b, whiten, self.reference, MARGIN, pull)


def _problems(
    bodies: Sequence[Body], scaled: _Scaled, estimate: BaseEstimate, joint: Nearest
) -> tuple[Inconsistency, ...]:
    """Bodies that cannot exist on their own, and those that cannot together."""
    found, alone = [], []
    # A barrel or rod regroups with links, and must not make room for one by a negative mass.
    parts = [body for body in bodies if not body.spatial]
    if parts and not scaled.exist(parts):
        parts = []
    for body in bodies:
        group = [body, *parts] if body.spatial else [body]
        if not scaled.exist(group):
            alone.append(scaled.nearest(group, estimate.covariance, _PULL_ALONE))
            found.append(_inconsistency(alone[-1], scaled, estimate, (body.name,)))
    if joint.distance > _TOGETHER_FACTOR * math.hypot(*(n.distance for n in alone)):
        found.append(_inconsistency(joint, scaled, estimate, joint.active))
    return tuple(found)


def _inconsistency(
    closest: Nearest, scaled: _Scaled, estimate: BaseEstimate, bodies: tuple[str, ...]
) -> Inconsistency:
    variance = np.diag(estimate.covariance) / scaled.norms**2
    known = bool((variance > 0.0).any())
    shift = np.abs(scaled.a @ closest.phi - scaled.b)
    if known:
        shift = shift / np.sqrt(variance + scaled.floor**2)
    order = np.argsort(-shift, kind="stable")
    named = tuple(estimate.names[k] for k in order if shift[k] >= _NAMED_SHARE * shift.max())
    return Inconsistency(bodies, closest.distance if known else math.inf, named)


def _consistent(
    body: Body, names: Sequence[str], phi: FloatArray, theta: FloatArray
) -> ConsistentBody:
    matrix = body.matrix(phi)
    depth = float(np.linalg.eigvalsh(matrix)[0])
    if not depth > 0.0:
        raise IdentError(f"body '{body.name}': the consistent values lost their definiteness")
    values = {names[k].rsplit(".", 1)[1]: float(theta[k]) for k in body.columns}
    return ConsistentBody(body.name, values, divergence(body, phi), depth, body.given)
