"""Binomial intervals for counts of cases."""

from __future__ import annotations

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
    """The share of true ones."""
    return Rate(sum(flags), len(flags))
