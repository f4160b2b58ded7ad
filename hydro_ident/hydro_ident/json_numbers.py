"""Numbers as JSON has them, which knows neither infinity nor NaN."""

from __future__ import annotations

import math


def finite(value: float | None) -> float | None:
    """A number, or None where it is infinite, NaN or none.

    Parameters
    ----------
    value : float or None

    Returns
    -------
    float or None
    """
    return value if value is not None and math.isfinite(value) else None
