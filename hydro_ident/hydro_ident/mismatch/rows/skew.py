"""Pressures and torques that are read a little after the positions: no physics of the machine.

A transducer's electronics filter over a tenth of a millisecond, and a bus carries pressures a part
of an interval after positions. A pressure read s late is, to first order,

    p(t) = p_read(t) + s dp_read/dt,

so that the force of what is read lacks s times A dp/dt of each chamber: tens of newtons in quick
motion of a heavy arm, and they go with its acceleration, as those of a spring or of a rotor would;
where one chamber's transducer is slower than the other's, with the load's, as dry friction may. So
do the compression and the edges' flows of the chambers. What multiplies these slopes is fitted,
chamber by chamber, with the base.

In a motion of few frequencies the columns look like what depends on the position, as a ripple's
does, and at reversals like dry friction: s is therefore known beforehand to what such parts make
of it, and half an interval is as far as it goes. What is later than that is a finding, the effect
`pressure_delay`, beside which none is fitted.

Torques of joints are those of commands held over an interval, or of the drives' currents some
cycles old. Unsaid, that looks like inertia and like coupling of joints. Drives of one machine are
alike: all torques have one skew, where one of its own would take up what a play does to a joint.
No effect has its name, so that it goes as far as drives and buses do.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from hydro_ident.mismatch.settings import LEAST_CYCLES
from hydro_model.effects.readings import EVERY_CHAMBER
from hydro_model.effects.targets import ActiveEffect

#: Effect that is the same thing, larger.
PRESSURE_DELAY = "pressure_delay"
#: The number of all torques among skews, behind the chambers, and what their skew is called.
TORQUES, TORQUE_SKEW = -1, "torque_skew"
#: Deviation of what is known of a skew before, s and intervals: filters of transducers settle in
#: tenths of a millisecond, and what is read in turns comes within a part of the interval.
USUAL_S, _USUAL_CYCLES = 2.5e-4, 0.125
#: The same of torques, in intervals: a command is held for one, and another goes by on the way.
_TORQUE_CYCLES = 2.5


def skew_name(cylinder: str, side: str) -> str:
    """What the skew of a chamber's pressure is called; in s.

    Parameters
    ----------
    cylinder, side : str
        Name of the cylinder, and `a` or `b`.
    """
    return f"{cylinder}.pressure_skew_{side}"


def usual_skew(reading: int, cycle_s: float) -> float:
    """Deviation of what is known of a skew before, s.

    Parameters
    ----------
    reading : int
        A chamber, or `TORQUES`.
    cycle_s : float
    """
    return cycle_s if reading == TORQUES else max(_USUAL_CYCLES * cycle_s, USUAL_S)


def largest_skew(reading: int, cycle_s: float) -> float:
    """Bound of a skew for readings at such an interval, s: a pressure's beyond it is a finding.

    Parameters
    ----------
    reading : int
        A chamber, or `TORQUES`.
    cycle_s : float
    """
    return (_TORQUE_CYCLES if reading == TORQUES else LEAST_CYCLES) * cycle_s


def is_unnamed(reading: int, skew_s: float) -> bool:
    """Whether a skew at its bound is that of a reading whose lateness no effect stands for.

    A pressure that is late beyond its bound is a finding. Positions that are, behind a filter of
    their own or with the bus, look like pressures that are early; nothing has that name, or that
    of late torques, and other laws would be taken for it.

    Parameters
    ----------
    reading : int
        A chamber, or `TORQUES`.
    skew_s : float
    """
    return reading == TORQUES or skew_s < 0.0


def is_listed(terms: Iterable[ActiveEffect], chamber: int) -> bool:
    """Whether a chamber's late pressure is an effect of a model: no skew is beside that."""
    return chamber != TORQUES and any(
        term.effect.name == PRESSURE_DELAY and term.index in (EVERY_CHAMBER, chamber)
        for term in terms
    )


def least_skew(term: ActiveEffect, chambers: Iterable[int], skews_s: Sequence[float]) -> float:
    """The least skew of the chambers that an effect delays, s; 0 of none.

    Parameters
    ----------
    term : ActiveEffect
    chambers : iterable of int
        Those whose skew is fitted.
    skews_s : sequence of float
        Of all chambers, two per cylinder; empty: none.
    """
    own = [skews_s[c] for c in chambers if skews_s and is_listed([term], c)]
    return min(own, default=0.0)
