"""Pressures that are read a little after the positions: no physics of the machine.

A transducer's electronics filter over a tenth of a millisecond, and a bus carries pressures a part
of an interval after positions. A force read s late is, to first order,

    F(t) = F_read(t) + s dF_read/dt,

so that what is read lacks s times its own slope: tens of newtons in quick motion of a heavy arm,
and they go with its acceleration, as those of a spring or of a rotor would. So do the compression
and the edges' flows of both chambers. What multiplies -dF_read/dt, and the balances' slopes, is
fitted, cylinder by cylinder, with the base.

In a motion of few frequencies the column looks like what depends on the position, as a ripple's
does, and at reversals like dry friction: s is therefore known beforehand to what such parts make
of it, and half an interval is as far as it goes. What is later than that is a finding, the effect
`pressure_delay`, beside which none is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.mismatch.settings import LEAST_CYCLES
from hydro_model.effects.readings import EVERY_CHAMBER
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Effect that is the same thing, larger.
PRESSURE_DELAY = "pressure_delay"
#: Deviation of what is known of a skew before, s: filters of transducers settle in tenths of a
#: millisecond, and a cycle's frames are on the bus within one.
USUAL_S = 2.5e-4
#: No base's pressures are read later, s.
_MOST_S = 1.0e-3


def skew_name(cylinder: str) -> str:
    """What the skew of a cylinder's pressures is called; in s."""
    return f"{cylinder}.pressure_skew"


def largest_skew(cycle_s: float) -> float:
    """Bound of a skew for readings at such an interval, s: what later ones are is a finding."""
    return min(LEAST_CYCLES * cycle_s, _MOST_S)


def skew_column(force: FloatArray, step_s: float) -> FloatArray:
    """What is read less what is there, per second that a smooth force (N, n) is read late."""
    if len(force) < 2:
        return np.zeros_like(force)
    return np.asarray(-np.gradient(force, step_s, axis=0))


def is_listed(terms: Sequence[ActiveEffect], cylinder: int) -> bool:
    """Whether a cylinder's late pressures are an effect of a model: no skew is beside that."""
    return any(
        term.effect.name == PRESSURE_DELAY
        and (term.index == EVERY_CHAMBER or term.cylinder == cylinder)
        for term in terms
    )
