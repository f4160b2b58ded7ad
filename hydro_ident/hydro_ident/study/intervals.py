"""Intervals for counts and means of cases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Rate:
    """A share of cases with its 95 % Clopper-Pearson interval.

    Attributes
    ----------
    hits, of : int
    """

    hits: int
    of: int

    @property
    def share(self) -> float | None:
        """None of no cases."""
        return self.hits / self.of if self.of else None

    @property
    def interval(self) -> tuple[float, float]:
        """From beta quantiles; 0 to 1 of no cases."""
        from scipy.stats import beta

        if not self.of:
            return 0.0, 1.0
        low = beta.ppf(0.025, self.hits, self.of - self.hits + 1) if self.hits else 0.0
        high = beta.ppf(0.975, self.hits + 1, self.of - self.hits) if self.hits < self.of else 1.0
        return float(low), float(high)

    def content(self) -> dict[str, object]:
        """For JSON."""
        return {"hits": self.hits, "of": self.of, "share": self.share, "ci95": self.interval}


def rate(flags: list[bool]) -> Rate:
    """The share of true ones.

    `flags` says of each case whether it counts.
    """
    return Rate(sum(flags), len(flags))


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean over cases with its 95 % interval by Student's t.

    Attributes
    ----------
    value : float or None
        None of no cases.
    of : int
    std_error : float or None
        None of fewer than two cases.
    """

    value: float | None
    of: int
    std_error: float | None

    @property
    def interval(self) -> tuple[float, float] | None:
        """None of fewer than two cases."""
        from scipy.stats import t

        if self.value is None or self.std_error is None:
            return None
        half = float(t.ppf(0.975, self.of - 1)) * self.std_error
        return self.value - half, self.value + half

    def content(self) -> dict[str, object]:
        """For JSON."""
        return {"mean": self.value, "of": self.of, "ci95": self.interval}


def mean(values: Sequence[float]) -> Mean:
    """The mean of some numbers."""
    count = len(values)
    if not count:
        return Mean(None, 0, None)
    value = sum(values) / count
    if count < 2:
        return Mean(value, count, None)
    variance = sum((v - value) ** 2 for v in values) / (count - 1)
    return Mean(value, count, math.sqrt(variance / count))
