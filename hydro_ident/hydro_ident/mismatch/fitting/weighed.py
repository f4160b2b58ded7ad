"""What is kept of a fit that is weighed against others: its numbers, no rows by columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.rows.prediction import Model
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """A fit's numbers and what it leaves.

    Attributes
    ----------
    model : Model
    names : tuple of str
        Of the numbers that were fitted.
    covariance : (p, p) array
        Theirs.
    left : (M,) array
        Whitened residual of the rows that it was fitted to.
    """

    model: Model
    names: tuple[str, ...]
    covariance: FloatArray
    left: FloatArray

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the numbers, by `names`."""
        return deviations_of(self.names, self.covariance)


def deviations_of(names: tuple[str, ...], covariance: FloatArray) -> dict[str, float]:
    """Standard deviations of numbers by their names.

    Parameters
    ----------
    names : tuple of str
    covariance : (p, p) array
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return dict(zip(names, std.tolist(), strict=True))
