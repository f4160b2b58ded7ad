"""Times that count from long ago: what goes before their first is kept as whole ns.

A double holds the seconds of today since 1970 in steps of 0.24 us, which is seen in a rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from hydro_ident.logs.file import Exact
from hydro_ident.logs.joining import slack_s
from hydro_ident.logs.signal import Clock
from hydro_model.arrays import FloatArray

#: Seconds beside which a double has no place for 1 ns; of more than the last no stamp is.
_FAR_S, _FURTHEST_S = 1e6, 1e12


@dataclass(frozen=True, slots=True)
class Seconds:
    """Times of a clock.

    Attributes
    ----------
    seconds : (N,) array
        Since the origin, without what the mapping says of a later zero.
    origin_ns : int
    late_s : float
        How much later than the log's zero the clock's is.
    signal : str
        That they are of; empty: they are counted.
    factor : float
        Of the recorded numbers to seconds.
    slack_s : float
        What their rounding may make of equal instants.
    """

    seconds: FloatArray
    origin_ns: int = 0
    late_s: float = 0.0
    signal: str = ""
    factor: float = 1.0
    slack_s: float = 1e-9

    def since(self, origin_ns: int) -> FloatArray:
        """Times since another origin, s.

        Parameters
        ----------
        origin_ns : int

        Returns
        -------
        (N,) array
        """
        return np.asarray(self.seconds + (self.late_s + (self.origin_ns - origin_ns) * 1e-9))


def seconds_of(clock: Clock, recorded: FloatArray, exact: Exact | None) -> Seconds:
    """Recorded numbers of a clock as times.

    Parameters
    ----------
    clock : Clock
    recorded : (N,) array
        NaN where there is no sample.
    exact : Exact or None
        The same numbers, where doubles do not hold them.

    Returns
    -------
    Seconds
    """
    known = np.flatnonzero(np.isfinite(recorded))
    first = float(recorded[known[0]]) if len(known) else 0.0
    origin = 0
    if _FAR_S <= abs(first) * clock.factor < _FURTHEST_S:
        one = 1 if exact is None else 10**exact.digits
        origin = math.floor(first) if exact is None else int(exact.whole[known[0]]) // one
    since = recorded - origin
    if exact is not None and origin:
        since[known] = (exact.whole[known] - origin * one) / one
    # Every unit of time is a whole number of ns.
    origin_ns = origin * round(clock.factor * 1e9)
    seconds = clock.factor * since
    rounded = seconds if exact is not None else clock.factor * recorded
    slack = slack_s(rounded[known]) if len(known) else 0.0
    return Seconds(seconds, origin_ns, clock.late_s, clock.signal, clock.factor, slack)


def instant_since(instant_s: float, origin_ns: int) -> float:
    """An instant as a person wrote it, since another origin, s.

    Its double is rounded; the shortest decimal number of that double is what was written.

    Parameters
    ----------
    instant_s : float
    origin_ns : int

    Returns
    -------
    float
    """
    if not math.isfinite(instant_s):
        return instant_s
    return float(Decimal(repr(float(instant_s))) - Decimal(origin_ns).scaleb(-9))
