"""A chamber's balance per sampling interval, and its slopes in what a base fits.

Rows of a balance are windows of these: volume swept, compression and flow over both edges at unit
coefficients, with how the latter change with the command's delay and all of them with the
pressure's skew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import Chamber, edge_integrals
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.contributions import compressed
from hydro_model.robot import FloatArray

#: Step of the slopes in time, in sampling intervals.
_STEP = 0.1


@dataclass(frozen=True, slots=True)
class Balance:
    """Rows of one chamber's balance.

    Attributes
    ----------
    swept : (W,) array
        Rate of the volume, m^3/s.
    compression : (W,) array
        Negative volume times rate of pressure; its coefficient is that of compressibility.
    edges, late, skewed : (W, 2) array
        Flow over both edges at unit coefficients, and its slopes in delay and skew.
    skewed_compression : (W,) array
        Slope of the compression in the skew.
    """

    swept: FloatArray
    compression: FloatArray
    edges: FloatArray
    late: FloatArray
    skewed: FloatArray
    skewed_compression: FloatArray

    @staticmethod
    def of(rows: FloatArray) -> Balance:
        """Of the windowed `balance_steps`, (W, 9)."""
        return Balance(
            rows[:, 0], rows[:, 1], rows[:, 2:4], rows[:, 4:6], rows[:, 6:8], rows[:, 8]
        )


def balance_steps(chamber: Chamber, trace: Trace, delay_s: float, rate: FloatArray) -> FloatArray:
    """Volumes of a chamber's balance per sampling interval, (N - 1, 9), as `Balance` has them.

    Parameters
    ----------
    chamber : Chamber
    trace : Trace
        With valve signals and rails as laws shape them.
    delay_s : float
        Of the valve's command.
    rate : (N,) array
        Of the chamber's pressure.
    """
    volume, squeezed = compressed(chamber, trace)
    step = _STEP * trace.step_s
    early = max(delay_s - step, 0.0)
    now, late, soon = (edge_integrals(chamber, trace, d) for d in (delay_s, delay_s + step, early))
    # What is read s late is s times its rate short of what is there.
    there = _ahead(chamber, trace, step * rate)
    squeezed_there = compressed(chamber, there)[1]
    edges_there = edge_integrals(chamber, there, delay_s)
    width = delay_s + step - early
    by_delay = [(a - b) / width for a, b in zip(late, soon, strict=True)]
    by_skew = [(a - b) / step for a, b in zip(edges_there, now, strict=True)]
    by_skew.append((squeezed - squeezed_there) / step)
    return np.stack([np.diff(volume), -squeezed, *now, *by_delay, *by_skew], axis=1)


def _ahead(chamber: Chamber, trace: Trace, change: FloatArray) -> Trace:
    """A trace with a chamber's pressure changed."""
    name = "p_a" if chamber.side == "a" else "p_b"
    pressures = getattr(trace, name).copy()
    pressures[:, chamber.index] += change
    return replace(trace, p_a=pressures) if name == "p_a" else replace(trace, p_b=pressures)
