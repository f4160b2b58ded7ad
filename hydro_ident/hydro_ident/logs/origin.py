"""Times that count from long ago: what goes before their first is kept as whole ns.

A double holds the seconds of today since 1970 in steps of 0.24 us, which is seen in a rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hydro_ident.logs.signal import Clock
from hydro_msgs_docs.cdr import FloatArray, IntArray

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
    """

    seconds: FloatArray
    origin_ns: int = 0
    late_s: float = 0.0
    signal: str = ""
    factor: float = 1.0

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


def seconds_of(clock: Clock, recorded: FloatArray, exact: IntArray | None) -> Seconds:
    """Recorded numbers of a clock as times.

    Parameters
    ----------
    clock : Clock
    recorded : (N,) array
        NaN where there is no sample.
    exact : (N,) int array or None
        The same numbers, where they are whole and doubles do not hold them.

    Returns
    -------
    Seconds
    """
    known = np.flatnonzero(np.isfinite(recorded))
    first = float(recorded[known[0]]) if len(known) else 0.0
    origin = 0
    if _FAR_S <= abs(first) * clock.factor < _FURTHEST_S:
        origin = math.floor(first) if exact is None else int(exact[known[0]])
    since = recorded - origin
    if exact is not None and origin:
        since[known] = exact[known] - origin
    # Every unit of time is a whole number of ns.
    origin_ns = origin * round(clock.factor * 1e9)
    return Seconds(clock.factor * since, origin_ns, clock.late_s, clock.signal, clock.factor)
