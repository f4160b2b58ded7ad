"""Quantiles of a stream of magnitudes in flat memory."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hydro_model.robot import FloatArray

#: Bins per decade, over 30 decades: a bin is 2.3 % wide.
_PER_DECADE, _DECADES = 100, 30
_LOWEST = -18


@dataclass(slots=True)
class Histogram:
    """Counts of magnitudes in logarithmic bins: order and pieces of the stream do not matter.

    Attributes
    ----------
    counts : (B,) int array
    zeros : int
        Values of exactly zero, or below all bins.
    """

    counts: NDArray[np.int64] = field(
        default_factory=lambda: np.zeros(_DECADES * _PER_DECADE, dtype=np.int64)
    )
    zeros: int = 0

    def add(self, sizes: FloatArray) -> None:
        """Count values >= 0; what is not finite is left out.

        `sizes` are the values.
        """
        sizes = sizes[np.isfinite(sizes)]
        positive = sizes[sizes > 10.0**_LOWEST]
        self.zeros += int(sizes.size - positive.size)
        index = np.floor((np.log10(positive) - _LOWEST) * _PER_DECADE).astype(np.intp)
        index = np.minimum(index, self.counts.size - 1)
        self.counts += np.bincount(index, minlength=self.counts.size)

    def merge(self, other: Histogram) -> None:
        """Take in the counts of another."""
        self.counts += other.counts
        self.zeros += other.zeros

    @property
    def total(self) -> int:
        """Number of values."""
        return int(self.counts.sum()) + self.zeros

    def quantile(self, share: float) -> float:
        """Value below which a share of the values lies, to 1.2 %; 0 where there are none."""
        wanted = share * self.total - self.zeros
        if wanted <= 0.0:
            return 0.0
        at = int(np.searchsorted(np.cumsum(self.counts), wanted))
        return float(10.0 ** (_LOWEST + (min(at, self.counts.size - 1) + 0.5) / _PER_DECADE))

    def share_above(self, size: float) -> float:
        """Share of the values above a size."""
        if self.total == 0 or size <= 0.0:
            return 0.0
        at = int(np.ceil((np.log10(size) - _LOWEST) * _PER_DECADE))
        return float(self.counts[max(at, 0) :].sum()) / self.total
