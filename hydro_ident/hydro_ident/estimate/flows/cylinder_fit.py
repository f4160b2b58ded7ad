"""Bulk modulus and valve edges of one cylinder, and what can be used of them.

Each chamber is fitted by itself (`hydro_ident.estimate.flows.chambers`); what the two chambers of
a cylinder share, the bulk modulus above all, is then combined weighted by its information. A
result outside physical bounds is rejected and said, never replaced.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from hydro_ident.estimate.flows.chambers import INVERSE_BULK, OVER_BULK, Chamber
from hydro_ident.estimate.flows.delay import FittedChamber
from hydro_ident.estimate.flows.shared_parameters import chambers_to_cylinder
from hydro_ident.estimate.flows.unread_rails import RailConstant
from hydro_ident.estimate.forces.bounds import DEVIATIONS, conditioned
from hydro_ident.estimate.forces.closed_chain import HeldPart
from hydro_ident.estimate.statistics.least_squares import MAX_COLLINEARITY, Fit
from hydro_ident.robots.robot_numbers import BULK_BOUNDS_PA
from hydro_ident.robots.robot_units import FLOWS_L_MIN, edge_l_min
from hydro_model.robot import FloatArray

#: Edges so many times those of the robot file, or as small a part of them, each of them, are of
#: signals in another unit: cold oil, worn edges and another spool make a tenth of that.
_OTHER_UNIT = 30.0


@dataclass(frozen=True, slots=True)
class ChamberFit:
    """Fit of one chamber alone.

    Attributes
    ----------
    chamber : Chamber
    names : tuple of str
        Of the columns.
    fit : Fit
    """

    chamber: Chamber
    names: tuple[str, ...]
    fit: Fit


@dataclass(frozen=True, slots=True)
class RefusedBulk:
    """A bulk modulus as it was fitted, which is not to be used; the edges beside it are.

    Attributes
    ----------
    inverse, std : float
        Of 1 / modulus, 1/Pa.
    reason : str
    told : bool
        The data tell it, and no oil has it.
    """

    inverse: float
    std: float
    reason: str
    told: bool


@dataclass(frozen=True, slots=True)
class CylinderFit:
    """Hydraulic parameters of one cylinder, both chambers combined.

    Attributes
    ----------
    cylinder, valve : str
    names : tuple of str
        `inverse_bulk_modulus`, the four edges, then linear parameters of listed effects.
    theta : (p,) array
    covariance : (p, p) array
    identifiable : tuple of bool
    rejected : str
        Why the values are not to be used; empty where they are good.
    chambers : tuple of ChamberFit
    dof : (p,) array
        Degrees of freedom of the standard deviations.
    held : tuple of HeldPart
        Effects' parameters at a bound, by column, with their own values.
    refused_bulk : RefusedBulk or None
        Where the bulk modulus alone cannot be used: the given one stands in its place.
    unfitted : {"", "a", "b"}
        The chamber that gave no or too few windows, whose edges stay as given.
    """

    cylinder: str
    valve: str
    names: tuple[str, ...]
    theta: FloatArray
    covariance: FloatArray
    identifiable: tuple[bool, ...]
    rejected: str
    chambers: tuple[ChamberFit, ...]
    dof: FloatArray = field(default_factory=lambda: np.zeros(0))
    held: tuple[HeldPart, ...] = ()
    refused_bulk: RefusedBulk | None = None
    unfitted: Literal["", "a", "b"] = ""

    def value(self, name: str) -> tuple[float, float]:
        """A parameter and its standard deviation."""
        at = self.names.index(name)
        return float(self.theta[at]), float(np.sqrt(self.covariance[at, at]))

    def bulk_modulus(self) -> tuple[float, float]:
        """Bulk modulus and its standard deviation (to first order), Pa."""
        inverse, std = self.value(INVERSE_BULK)
        return 1.0 / inverse, std / inverse**2

    def of_other_signals(self, why: str) -> CylinderFit:
        """Rejected as of signals that are not what they are taken for.

        What the data bear on at all then counts as told: no other motion would tell it better.

        Parameters
        ----------
        why : str
        """
        bulk = self.refused_bulk is not None
        known = [
            (bulk and name == INVERSE_BULK) or bool(variance > 0.0 and self._apart(name))
            for name, variance in zip(self.names, np.diag(self.covariance), strict=True)
        ]
        told = tuple(a or b for a, b in zip(self.identifiable, known, strict=True))
        return replace(self, rejected=why, identifiable=told)

    def _apart(self, name: str) -> bool:
        own = [c.fit.collinearity[c.names.index(name)] for c in self.chambers if name in c.names]
        return min(own, default=0.0) < math.inf


def combined(
    fitted: Sequence[tuple[Chamber, FittedChamber]], rails: Sequence[RailConstant] = ()
) -> CylinderFit:
    """Merge chambers: parameters of the same name are one, weighted by their information.

    Parameters
    ----------
    fitted : sequence of (Chamber, FittedChamber)
        Of one cylinder.
    rails : sequence of RailConstant
        Of rails that nobody read.

    Returns
    -------
    CylinderFit
        With what cannot be used of it said.
    """
    fits = [ChamberFit(chamber, one.names, one.fit) for chamber, one in fitted]
    names = tuple(dict.fromkeys(name for f in fits for name in f.names))
    order = sorted(names, key=lambda n: (n != INVERSE_BULK, not n.startswith("c_")))
    path = chambers_to_cylinder([one for _, one in fitted], order)
    theta = path @ np.concatenate([f.fit.theta for f in fits])
    covariance = path @ block_diag(*(f.fit.covariance for f in fits)) @ path.T
    # Noise alone decides what the data tell; causes from outside widen its interval.
    noise = np.sqrt(np.diag(covariance))
    # A delay beyond its bound, or a rail that nobody read, moves the chambers together.
    for shifts in zip(*(one.shifts(rails) for _, one in fitted), strict=True):
        shift = path @ np.concatenate(shifts)
        covariance += np.outer(shift, shift)
    collinear = np.array(
        [max(f.fit.collinearity[f.names.index(n)] for f in fits if n in f.names) for n in order]
    )
    # Edges and compliance are clear of zero; what an effect adds may well be none.
    known = tuple(
        bool(c < MAX_COLLINEARITY and (DEVIATIONS * s < abs(v) or not _essential(name)))
        for name, c, s, v in zip(order, collinear, noise, theta, strict=True)
    )
    chamber = fits[0].chamber
    found = CylinderFit(
        chamber.cylinder.name,
        chamber.valve.name,
        tuple(order),
        np.asarray(theta, dtype=float),
        np.asarray(covariance, dtype=float),
        known,
        "",
        tuple(fits),
        _combined_dof(fits, order),
        unfitted="" if len(fits) > 1 else "b" if chamber.side == "a" else "a",
    )
    return _checked(found, chamber.cylinder.bulk_modulus_pa)


def _combined_dof(fits: Sequence[ChamberFit], order: Sequence[str]) -> FloatArray:
    """Welch and Satterthwaite: chambers' degrees of freedom by their share of the information."""
    result = np.ones(len(order))
    for i, name in enumerate(order):
        at = [(f.fit, f.names.index(name)) for f in fits if name in f.names]
        information = np.array([1.0 / max(fit.covariance[j, j], 1e-300) for fit, j in at])
        shares = information / information.sum()
        dof = np.array([fit.dof[j] for fit, j in at])
        result[i] = 1.0 / float(np.sum(shares**2 / dof))
    return result


def _essential(name: str) -> bool:
    return name == INVERSE_BULK or name.startswith("c_")


def _checked(fit: CylinderFit, given_pa: float) -> CylinderFit:
    """A fit with what cannot be used of it: all, or the bulk modulus alone."""
    if wrong := _wrong_edges(fit) or _other_unit(fit):
        return fit.of_other_signals(wrong)
    bulk = _bulk_reason(fit)
    if bulk and not _edge_reason(fit) and _is_apart(fit):
        held = _with_given_bulk(fit, 1.0 / given_pa, bulk)
        if not _edge_reason(held):
            return held
    pairs = zip(fit.names, fit.identifiable, strict=True)
    unknown = [name for name, known in pairs if _essential(name) and not known]
    told = f"{', '.join(unknown)} cannot be told from these data" if unknown else ""
    return replace(fit, rejected=told or _edge_reason(fit) or bulk)


def _is_apart(fit: CylinderFit) -> bool:
    """Whether the bulk modulus can be off by itself: compliance below none is of all columns.

    And what is listed as a volume over it has no size without it.
    """
    inverse, std = fit.value(INVERSE_BULK)
    return inverse >= -DEVIATIONS * std and not any(n.endswith(OVER_BULK) for n in fit.names)


def _with_given_bulk(fit: CylinderFit, inverse: float, reason: str) -> CylinderFit:
    """The given modulus in the place of the fitted one, and the others as they are beside it.

    Where the data contradict the given one, the others would have to make that good: they stay as
    they were fitted.
    """
    at, (own, std) = fit.names.index(INVERSE_BULK), fit.value(INVERSE_BULK)
    theta, covariance = fit.theta.copy(), fit.covariance.copy()
    if abs(own - inverse) > DEVIATIONS * std:
        theta[at], covariance[at], covariance[:, at] = inverse, 0.0, 0.0
    else:
        theta, covariance = conditioned(theta, covariance, {at: inverse})
    return replace(
        fit,
        theta=theta,
        covariance=covariance,
        identifiable=tuple(known and k != at for k, known in enumerate(fit.identifiable)),
        refused_bulk=RefusedBulk(own, std, reason, fit.identifiable[at]),
    )


def _edge_reason(fit: CylinderFit) -> str:
    """Why a cylinder's edges cannot be used; empty where they can."""
    unknown = [name for name in _edges(fit) if not fit.identifiable[fit.names.index(name)]]
    return f"{', '.join(unknown)} cannot be told from these data" if unknown else _wrong_edges(fit)


def _edges(fit: CylinderFit) -> list[str]:
    return [name for name in fit.names if name.startswith("c_")]


def _wrong_edges(fit: CylinderFit) -> str:
    """Edges that the data tell and no valve has, with the likely cause; empty where none is."""
    told = [name for name in _edges(fit) if fit.identifiable[fit.names.index(name)]]
    wrong = {name: value for name in told if (value := fit.value(name)[0]) <= 0.0}
    if not wrong:
        return ""
    if set(wrong) == set(_edges(fit)):
        return reversed_edges(fit.valve, wrong)
    return f"{_expected(wrong)}{_cause_of(set(wrong), fit)}"


def reversed_edges(valve: str, wrong: Mapping[str, float]) -> str:
    """What it says that all of a valve's edges are below zero.

    Parameters
    ----------
    valve : str
    wrong : mapping of str to float
        The edges, by name.
    """
    return (
        f"{_expected(wrong)}; all are below it: the sign of {valve}'s signal is likely reversed,"
        " or that of the piston's position"
    )


def _expected(wrong: Mapping[str, float]) -> str:
    found = ", ".join(f"{name} = {value:.3g}" for name, value in wrong.items())
    return f"expected edge coefficients above 0, found {found}"


def _cause_of(wrong: set[str], fit: CylinderFit) -> str:
    for rail, of_rail in (("supply", {"c_pa", "c_pb"}), ("tank", {"c_at", "c_bt"})):
        if wrong == of_rail.intersection(_edges(fit)):
            return f"; those of the {rail} alone are below it: its reading is likely wrong"
    return ""


def edges_off(fit: CylinderFit) -> float:
    """How many times those of the robot file a cylinder's edges are, where a unit is mistaken.

    Parameters
    ----------
    fit : CylinderFit

    Returns
    -------
    float
        Of the edge that is nearest to the file's; 1 where the edges that the data tell are not all
        off to one side by far more than valves differ, or the file's are no valve's themselves.
    """
    valve, ratios = fit.chambers[0].chamber.valve, list[float]()
    for name in _edges(fit):
        given = float(getattr(valve, name))
        if not FLOWS_L_MIN[0] <= edge_l_min(given) <= FLOWS_L_MIN[1]:
            return 1.0
        if fit.identifiable[fit.names.index(name)]:
            ratios.append(fit.value(name)[0] / given)
    if not ratios or min(ratios) <= 0.0:
        return 1.0
    if min(ratios) > _OTHER_UNIT:
        return min(ratios)
    return max(ratios) if max(ratios) < 1.0 / _OTHER_UNIT else 1.0


def _other_unit(fit: CylinderFit) -> str:
    """Which units are likely mistaken where edges are far off the file's; empty where not."""
    off = edges_off(fit)
    if off == 1.0:
        return ""
    above = "small (V read as mV), or time too short (s read as ms)"
    below = "large (mV read as V), or time too long (ms read as s)"
    size, mistaken = (f"at least {off:.0f}", above) if off > 1.0 else (f"at most {off:.2g}", below)
    valve = fit.chambers[0].chamber.valve
    name = next(n for n in _edges(fit) if fit.identifiable[fit.names.index(n)])
    found, given = (edge_l_min(c) for c in (fit.value(name)[0], float(getattr(valve, name))))
    return (
        f"every edge is {size} times the robot file's ({name} {found:.3g} l/min at 35 bar, given"
        f" {given:.3g}): {valve.name}'s voltage is likely read too {mistaken}"
    )


def _bulk_reason(fit: CylinderFit) -> str:
    """Why a cylinder's bulk modulus cannot be used; empty where it can."""
    if not fit.identifiable[fit.names.index(INVERSE_BULK)]:
        return f"{INVERSE_BULK} cannot be told from these data"
    low, high = BULK_BOUNDS_PA
    inverse = fit.value(INVERSE_BULK)[0]
    if 1.0 / high <= inverse <= 1.0 / low:
        return ""
    found = f"{1.0 / inverse:.3g}" if inverse > 0.0 else f"1 / ({inverse:.3g} 1/Pa)"
    return f"expected a bulk modulus from {low:.0e} to {high:.0e} Pa, found {found}"
