"""An effect fitted in the place of a finding: the name it bears, and bounds that it ran to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.trials.exclusion import exclude, rival
from hydro_model.effects.law import ParameterSpec
from hydro_model.effects.targets import ActiveEffect

DRY, BRISTLE = "coulomb_friction", "presliding_friction"
#: Ranges of a parameter outside which a law is nothing but another one's, rounded: a bristle that
#: bends over less than a tenth of a millimetre, or friction that falls off over more than any slow
#: motion, is Coulomb's law.
LIMITS = {
    BRISTLE: ("distance", 1.0e-4, np.inf, DRY),
    "stribeck_friction": ("stribeck_velocity", 0.0, 0.05, DRY),
}
#: Within this factor beyond its limit a law still bears its own name as well: the limit is a
#: convention, and by what damps a bristle one of 0.15 mm may come out at 0.08.
_BORDER = 2.0
#: ... and up to this factor within it a bristle bears the other name as well: what is meant by dry
#: friction is often simulated by a bristle, of tenths of a millimetre.
_AS_DRY = 3.0
#: Limits on joints without cylinder: a mode above the 10 Hz that rows of torques keep is stiff
#: there, and what its inertia does to its own joint alone is a rotor's.
DRIVE_LIMITS = {"structural_flexibility": ("frequency", 0.0, 12.0, "rotor_inertia")}
#: What turns is slow, and bends, by what a piston does at a lever of a quarter of a metre.
_TURNING = {
    BRISTLE: ("distance", 4.0e-4, np.inf, DRY),
    "stribeck_friction": ("stribeck_velocity", 0.0, 0.2, DRY),
}
#: Sizes below which a finding is none, under the tip (or at what slides) and at what turns: what
#: gives way by a metre under a push of 100 N is no ground, and nothing that turns an arm by a
#: radian under 2 kN m.
_LEAST = {("external_contact", "stiffness"): (100.0, 2000.0)}
#: Share of itself that a size's deviation is at most where the rows tell it.
_TOLD = 0.5
#: A parameter is at a bound within this share of it.
_BOUND = 1.0e-3


@dataclass(frozen=True, slots=True, eq=False)
class Contender:
    """An effect fitted in the place of a finding.

    Attributes
    ----------
    term : ActiveEffect
        As fitted.
    fitted : Weighed
    gain : float
        Reduction of the sum of squares, in units of the noise's variance.
    held_out : float
        The same on held-out blocks.
    cost : float
        Log-likelihood that its parameters have to pay for.
    """

    term: ActiveEffect
    fitted: Weighed
    gain: float
    held_out: float
    cost: float

    @property
    def name(self) -> str:
        """The name that it bears: where a law has run to another one's limit, that one's."""
        return self._named_within(1.0)

    @property
    def border_names(self) -> tuple[str, ...]:
        """Further names near a limit: the law's own beyond it, a bristle's other within it."""
        names = [self._named_within(_BORDER)]
        if self.name == BRISTLE:
            names.append(self._named_within(1.0 / _AS_DRY))
        return tuple(name for name in dict.fromkeys(names) if name != self.name)

    @property
    def sized(self) -> bool:
        """Whether the rows tell how large it is, by any of its sizes."""
        return any(sizes_told(self.term, self.fitted.deviations))

    def rivals(self, other: Contender) -> bool:
        """Whether two cannot stand side by side, by their laws or by the names that they bear."""
        near = self.term.target == other.term.target
        return rival(self.term, other.term) or (near and exclude(self.name, other.name))

    @property
    def _limits(self) -> Mapping[str, tuple[str, float, float, str]]:
        """Ranges outside which its law is another one's."""
        return _limits_at(self.term)

    def _named_within(self, factor: float) -> str:
        """The name with limits this much wider."""
        effect = self.term.effect
        if effect.name in self._limits:
            parameter, least, most, other = self._limits[effect.name]
            at = [p.name for p in effect.parameters].index(parameter)
            if not least / factor <= self.term.parameters[at] <= factor * most:
                return BRISTLE if other == DRY and self._bends_within(factor) else other
        return effect.name

    def _bends_within(self, factor: float) -> bool:
        """Whether a dry friction that has lost its dip gives way as far as bristles do."""
        names = [p.name for p in self.term.effect.parameters]
        parameter, least, _, _ = self._limits[BRISTLE]
        return parameter in names and bool(
            self.term.parameters[names.index(parameter)] >= least / factor
        )


def _limits_at(term: ActiveEffect) -> Mapping[str, tuple[str, float, float, str]]:
    if term.joint is None:
        return LIMITS
    # Of the first joint a rotor is part of the link's inertia, and nothing is left to name.
    drive = DRIVE_LIMITS if term.joint else {}
    # What slides does so in metres, as a piston does.
    return LIMITS | drive | ({} if term.prismatic else _TURNING)


def as_dry(bristle: ActiveEffect) -> bool:
    """Whether a bristle bends over no more than what is called dry friction still.

    Parameters
    ----------
    bristle : ActiveEffect
    """
    at, most = _dry_travel(bristle)
    return bool(bristle.parameters[at] <= most)


def held_dry(bristle: ActiveEffect) -> ActiveEffect:
    """A bristle that no fit bends over more than what is called dry friction still.

    Parameters
    ----------
    bristle : ActiveEffect
        As `as_dry`.
    """
    at, most = _dry_travel(bristle)
    specs = list(bristle.effect.parameters)
    specs[at] = replace(specs[at], upper=most)
    return replace(bristle, effect=replace(bristle.effect, parameters=tuple(specs)))


def _dry_travel(bristle: ActiveEffect) -> tuple[int, float]:
    """Which parameter of a bristle is its travel, and the longest of what is dry friction."""
    parameter, least, _, _ = _limits_at(bristle)[BRISTLE]
    return [p.name for p in bristle.effect.parameters].index(parameter), _AS_DRY * least


def sizes_told(term: ActiveEffect, deviations: Mapping[str, float]) -> tuple[bool, ...]:
    """Whether the rows tell each size of an effect to half of it (one deviation).

    Parameters
    ----------
    term : ActiveEffect
        As fitted.
    deviations : mapping of str to float
        Of the fit's numbers, as `Weighed.deviations`.
    """
    sizes = [(term.effect.parameters[k].name, abs(term.parameters[k])) for k in term.effect.sizes]
    own = f"{term.target}.{term.effect.name}."
    return tuple(deviations.get(own + name, 0.0) <= _TOLD * size for name, size in sizes)


def at_a_bound(term: ActiveEffect) -> str:
    """Why an effect that ran to the end of its physical range is none; empty where it did not."""
    for i in term.effect.sizes:
        spec, value = term.effect.parameters[i], float(term.parameters[i])
        told = f"{value:.3g} {term.units[i]}"
        # None of it and all of it (a share of 1) are no ends of a range.
        ends = [e for e in (spec.lower, spec.upper) if np.isfinite(e) and e not in (0.0, 1.0)]
        if any(abs(value - end) <= _BOUND * abs(end) for end in ends):
            return f"its {spec.name} ran to the end of what is possible ({told})"
        linear, turning = _LEAST.get((term.effect.name, spec.name), (-np.inf, -np.inf))
        if value < (linear if term.everywhere or term.prismatic else turning):
            return f"its {spec.name} is below any that bears the name ({told})"
    return ""


def shape_at_an_end(spec: ParameterSpec, value: float) -> bool:
    """Whether a parameter is a shape that stands at an end of its range."""
    ends = [e for e in (spec.lower, spec.upper) if np.isfinite(e)]
    return not spec.linear and any(abs(value - end) <= _BOUND * abs(end) for end in ends)


def shape_at_a_bound(term: ActiveEffect) -> str:
    """Why a law in a shape that ran to the end of its range is none in a few motions.

    Where motions are many such a shape may say that it does not matter; a few of them bend any law
    until it fits.
    """
    for spec, value in zip(term.effect.parameters, term.parameters, strict=True):
        # None of it is no end of a range; where a law has one shape alone, that is its own.
        ends = [e for e in (spec.lower, spec.upper) if np.isfinite(e) and e not in (0.0, 1.0)]
        if not spec.linear and any(abs(value - end) <= _BOUND * abs(end) for end in ends):
            return f"in so few motions a {spec.name} at the end of its range tells of no law"
    return ""
