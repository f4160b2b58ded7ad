"""Oil columns of the chambers: the lengths in eqs. 14, 23 and 24."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_control.state.axes import Axis
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import FloatArray

#: Share of the stroke kept from either end. There what the swept column leaves out is most of the
#: oil: hoses and valve blocks hold a third of a litre to two, as much as 10 to 70 % of a stroke of
#: such cylinders. Counted on as too stiff, the oil is fed too little: the force comes late, and
#: the arm swings before the end. Too soft by this much the loop stays steady with no hose at all.
STROKE_MARGIN = 0.1


@dataclass(frozen=True, slots=True)
class OilColumns:
    """Per axis, (n,) each.

    Attributes
    ----------
    a_m, b_m : array
        Lengths of oil of the cylinder's area and bulk modulus that are as soft as chambers A
        and B: x and S - x, longer by dead volume and by air.
    leak : array or None
        Flow term of what enters the chambers past the valve, ``q_A / a - q_B / b`` in m^2/s;
        None for nothing.
    """

    a_m: FloatArray
    b_m: FloatArray
    leak: FloatArray | None = None


def piston_positions(axes: Sequence[Axis], q: FloatArray) -> FloatArray:
    """Pistons from the bottoms of their cylinders, (n,) m."""
    return np.array([float(stroke(a.cylinder, angle)) for a, angle in zip(axes, q, strict=True)])


def swept_columns(axes: Sequence[Axis], q: FloatArray) -> OilColumns:
    """The columns of eq. 14: x and S - x, kept `STROKE_MARGIN` from the ends."""
    full = np.array([axis.cylinder.stroke_m for axis in axes])
    x = piston_positions(axes, q)
    kept = np.minimum(np.maximum(x, STROKE_MARGIN * full), (1.0 - STROKE_MARGIN) * full)
    return OilColumns(kept, full - kept)
