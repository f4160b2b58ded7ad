"""What the positions' noise does to the parameters of the forces, and filters that bear it.

Noise in accelerations is noise in the columns of the inertias: least squares make these smaller,
by the noise's share of what the accelerations are, and no interval knows of it. How much is seen
by adding as much noise again (Cook and Stefanski's SIMEX), once as drawn and once with the
opposite sign: the mean of both has no chance of first order in it. Where that moves a parameter
by a good part of its deviation, filters are taken slower as long as errors become smaller by it:
the noise in an acceleration grows with the band's power of 2.5, and a crane's motion is slow.
What is left is counted into the intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from hydro_ident.estimate.forces.inertial import InertialFit, inertial_fit
from hydro_ident.estimate.scoring.noise import acceleration_noise, encoder_noise
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.identify.gathering import GatherPlan, gather_source
from hydro_ident.recordings.sources import Source
from hydro_ident.recordings.workers import Workers
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray, Robot

#: Share of an acceleration's variance that noise may be without another look: it moves an inertia
#: by as much, and none is known better.
_SLIGHT = 5.0e-4
#: Deviations by which a parameter may be moved.
_BORNE = 0.5
#: Slower cut-offs that are tried, as shares of the usual ones, down to that of forces below which
#: the hydraulic mode goes, and filters take over 1.5 s to settle at both ends of a stretch.
_SHARES, _SLOWEST_HZ = (0.6, 0.4), 4.0


@dataclass(frozen=True, slots=True)
class PositionBias:
    """What the positions' noise does at the filters that bear it best.

    Attributes
    ----------
    filters : FilterSettings
    shift : (p,) array
        What it moves the parameters of the force model by; empty where it is slight.
    notes : tuple of str
    """

    filters: FilterSettings
    shift: FloatArray = field(default_factory=lambda: np.zeros(0))
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Look:
    """How recordings are looked at.

    Attributes
    ----------
    plan_at : callable
        The plan with some filters.
    sources : sequence of Source
    still : tuple of int
        Joints that did not move.
    signals : SignalSurvey
    workers : Workers
    """

    plan_at: Callable[[FilterSettings], GatherPlan]
    sources: Sequence[Source]
    still: tuple[int, ...]
    signals: SignalSurvey
    workers: Workers


@dataclass(frozen=True, slots=True)
class _Tried:
    fit: InertialFit
    shift: FloatArray

    @property
    def known(self) -> BoolArray:
        return np.array(self.fit.identifiable) & (self.fit.fit.std > 0.0)

    @property
    def most(self) -> tuple[int, float]:
        """The parameter that is moved by most of its deviations, and by how many."""
        std = np.where(self.known, self.fit.fit.std, np.inf)
        moved = np.abs(self.shift) / std
        return int(np.argmax(moved)), float(moved.max())

    def better(self, other: _Tried) -> bool:
        """Whether more is known than of another, or as much with smaller errors on average."""
        counts = int(self.known.sum()), int(other.known.sum())
        if counts[0] != counts[1]:
            return counts[0] > counts[1]
        both = self.known & other.known
        own, old = (np.hypot(one.fit.fit.std, one.shift)[both] for one in (self, other))
        return bool(np.log(own).sum() < np.log(old).sum())


def position_bias(look: Look, asked: FilterSettings, free: bool) -> PositionBias:
    """Filters that bear the positions' noise, and what it still does there.

    Parameters
    ----------
    look : Look
    asked : FilterSettings
        As recordings bear them.
    free : bool
        They may be slower than that: nobody chose them.

    Returns
    -------
    PositionBias
        The filters that were asked for, without a shift, where noise is slight.
    """
    noise = encoder_noise(look.signals)
    if not _matters(look, noise, asked):
        return PositionBias(asked)
    best: _Tried | None = None
    for slower in _slower(asked, free):
        tried = _tried(look, slower, noise)
        if tried is None or (best is not None and not tried.better(best)):
            break
        best = tried
        if best.most[1] <= _BORNE:
            break
    if best is None:
        return PositionBias(asked)
    shift = np.where(np.isfinite(best.shift), best.shift, 0.0)
    return PositionBias(best.fit.settings, shift, _notes(look, asked, best, noise))


def with_bias(fit: InertialFit, bias: PositionBias) -> InertialFit:
    """A fit whose covariance counts what the positions' noise moves it by.

    Parameters
    ----------
    fit : InertialFit
    bias : PositionBias
    """
    if not bias.shift.size:
        return fit
    shift = bias.shift.copy()
    shift[[part.index for part in fit.held]] = 0.0
    covariance = fit.fit.covariance + np.outer(shift, shift)
    return replace(fit, fit=replace(fit.fit, covariance=covariance))


def _slower(asked: FilterSettings, free: bool) -> Iterator[FilterSettings]:
    yield asked
    for share in _SHARES if free else ():
        hz = share * asked.parallel_hz
        if hz >= _SLOWEST_HZ:
            rate = share * asked.differentiation_hz
            yield replace(asked, differentiation_hz=rate, parallel_hz=hz)


def _matters(look: Look, noise: FloatArray, filters: FilterSettings) -> bool:
    """Whether noise is a share of some acceleration that a fit may see."""
    if not look.signals.curved:
        return False
    left = acceleration_noise(look.signals, filters) ** 2
    moving = [j for j in range(noise.size) if j not in look.still]
    curved = look.signals.curving(noise) ** 2
    return bool((left > _SLIGHT * curved)[moving].any())


def _tried(look: Look, filters: FilterSettings, noise: FloatArray) -> _Tried | None:
    plan = replace(look.plan_at(filters), flows=False, position_noise=np.stack([noise, -noise]))
    gathered = look.workers.map(partial(gather_source, plan=plan), look.sources)
    fits = []
    for one in zip(*([g.forces, *g.disturbed] for g in gathered if g.forces), strict=True):
        fits.append(inertial_fit(plan.model, list(one), look.still, filters))
    if len(fits) < 3 or any(fit is None for fit in fits):
        return None
    plain, more, less = (fit for fit in fits if fit is not None)
    shift = 0.5 * (more.fit.theta + less.fit.theta) - plain.fit.theta
    return _Tried(plain, shift)


def _notes(look: Look, asked: FilterSettings, best: _Tried, noise: FloatArray) -> tuple[str, ...]:
    at, moved = best.most
    filters, robot = best.fit.settings, look.signals.robot
    slower = filters.parallel_hz < asked.parallel_hz
    if not slower and moved <= _BORNE:
        return ()
    heard = (
        f" motion is looked at below {filters.differentiation_hz:.3g} Hz, forces below"
        f" {filters.parallel_hz:.3g} Hz, and there"
        if slower
        else ""
    )
    return (
        f"positions are noisy beside their accelerations ({_sizes(robot, noise)}):{heard} it moves"
        f" {best.fit.model.names[at]} most, by about {best.shift[at]:.3g} ({moved:.1f} standard"
        " deviations), which intervals count; /joint_reference, recorded, would tell without it",
    )


def _sizes(robot: Robot, noise: FloatArray) -> str:
    units = ["m" if joint.prismatic else "rad" for joint in robot.joints]
    each = zip(robot.joint_names, noise.tolist(), units, strict=True)
    return ", ".join(f"{name} {size:.2g} {unit} rms" for name, size, unit in each)
