"""The compiled root of a valve's edges: of simulation, control and identification alike."""

from __future__ import annotations

import math

from hydro_model.hydraulics.valve import SMOOTH_PRESSURE_PA
from hydro_model.numerics.kernel import inlined

_SMOOTH_SQUARED = SMOOTH_PRESSURE_PA**2


@inlined
def root(difference_pa: float) -> float:
    """`hydro_model.hydraulics.valve.signed_root` of one `difference_pa` in Pa; sqrt(Pa).

    Two square roots are quicker than a power, and may differ from it in the last digit.
    """
    return difference_pa / math.sqrt(math.sqrt(difference_pa * difference_pa + _SMOOTH_SQUARED))
