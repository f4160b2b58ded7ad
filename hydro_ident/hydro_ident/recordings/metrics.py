"""How well the tip followed its reference: the figures of the paper's Table IV.

``rho = max |e| / max |v|``: the largest error over the largest speed, in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.bag.gaps import find_gaps, usual_period_s
from hydro_ident.errors import NotEnoughDataError
from hydro_model.arrays import FloatArray, IntArray

#: Half width, in cycles, of the symmetric difference that gives the speed: zero-phase. The
#: true tip is exact; an encoder's count noise needs the wider one (20 ms at 500 Hz, which
#: lowers a speed's peak by less than 1e-4 on a path of several seconds).
TRUTH_HALF_WIDTH = 1
ENCODER_HALF_WIDTH = 5
_STILL_M = 1e-9


@dataclass(frozen=True, slots=True)
class Tracking:
    """Figures of one run.

    Attributes
    ----------
    rmse_mm, max_error_mm : float
        Of the distance between tip and reference.
    max_speed_m_s : float
        Of the tip.
    rho_s : float
    reference_speed_m_s : float
        Largest speed of the reference: a run that exceeds it by 10 % is void.
    duration_s : float
        Of the span in which the reference moves.
    cycles : int
        Compared cycles.
    gaps, missing : int
        Gaps in that span, and cycles missing in them.
    without : int
        Cycles of that span without a tip or a reference: there, but not compared.
    """

    rmse_mm: float
    max_error_mm: float
    max_speed_m_s: float
    rho_s: float
    reference_speed_m_s: float
    duration_s: float
    cycles: int
    gaps: int
    missing: int
    without: int

    @property
    def holes(self) -> list[str]:
        """What of the span was not compared, in words."""
        told = []
        if self.gaps:
            plural = "s" if self.gaps > 1 else ""
            told.append(
                f"{self.gaps} gap{plural} while the reference moves, {self.missing} cycles"
                " missing: nobody knows the errors in them"
            )
        if self.without:
            of = self.without + self.cycles
            told.append(
                f"{self.without} of {of} cycles while the reference moves have no tip or no"
                " reference: they are not compared"
            )
        return told


def moving_span(reference_m: FloatArray) -> slice:
    """From the first to the last cycle in which a reference moves, holds in between included.

    Parameters
    ----------
    reference_m : (N, 3) array
        NaN where there is none.

    Returns
    -------
    slice

    Raises
    ------
    NotEnoughDataError
        It never moves.
    """
    there = np.flatnonzero(np.isfinite(reference_m).all(axis=1))
    step = np.linalg.norm(np.diff(reference_m[there], axis=0), axis=1)
    moving = np.flatnonzero(step > _STILL_M)
    if not len(moving):
        raise NotEnoughDataError("the tip reference never moves: nothing to compare")
    return slice(int(there[moving[0]]), int(there[moving[-1] + 1]) + 1)


def speed_m_s(stamp_ns: IntArray, position_m: FloatArray, half_width: int) -> FloatArray:
    """Speed by symmetric differences, ``|p(k + w) - p(k - w)| / (t(k + w) - t(k - w))``.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
    position_m : (N, 3) array
    half_width : int
        w, cycles.

    Returns
    -------
    (N - 2 w,) array
        m/s, empty where N is too small.
    """
    width = 2 * half_width
    if len(stamp_ns) <= width:
        return np.zeros(0)
    distance = np.linalg.norm(position_m[width:] - position_m[:-width], axis=1)
    speed: FloatArray = distance / ((stamp_ns[width:] - stamp_ns[:-width]) * 1e-9)
    return speed


def tracking(
    stamp_ns: IntArray, tip_m: FloatArray, reference_m: FloatArray, *, half_width: int
) -> Tracking:
    """Tracking figures over the span in which the reference moves.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
    tip_m, reference_m : (N, 3) arrays
        Rows with NaN are left out of the errors.
    half_width : int
        Of the difference that gives the speed, cycles.

    Returns
    -------
    Tracking

    Raises
    ------
    NotEnoughDataError
        The reference never moves, or no cycle has both tip and reference.
    """
    span = moving_span(reference_m)
    stamp_ns, tip_m, reference_m = stamp_ns[span], tip_m[span], reference_m[span]
    error_m = np.linalg.norm(tip_m - reference_m, axis=1)
    compared = np.isfinite(error_m)
    speed = speed_m_s(stamp_ns, tip_m, half_width)
    speed = speed[np.isfinite(speed)]
    if not compared.any() or not len(speed) or float(speed.max()) == 0.0:
        raise NotEnoughDataError("the tip does not move while its reference does")
    reference_speed = speed_m_s(stamp_ns, reference_m, TRUTH_HALF_WIDTH)
    error_m = error_m[compared]
    gaps = find_gaps(stamp_ns, usual_period_s(stamp_ns))
    return Tracking(
        rmse_mm=float(np.sqrt(np.mean(error_m**2)) * 1e3),
        max_error_mm=float(error_m.max() * 1e3),
        max_speed_m_s=float(speed.max()),
        rho_s=float(error_m.max() / speed.max()),
        reference_speed_m_s=float(np.nanmax(reference_speed)),
        duration_s=float(stamp_ns[-1] - stamp_ns[0]) * 1e-9,
        cycles=int(compared.sum()),
        gaps=len(gaps),
        missing=sum(gap.missing for gap in gaps),
        without=int((~compared).sum()),
    )
