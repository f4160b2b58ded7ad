"""What this package raises on purpose."""

from __future__ import annotations

import numpy as np

from hydro_model.errors import HydroError


class ControlError(HydroError):
    """A controller that cannot be set up as asked, or a reference that it refuses."""


#: What arithmetic raises where numbers leave its range: what cannot be computed is refused.
NUMERICAL_ERRORS = (ValueError, ArithmeticError, np.linalg.LinAlgError)
