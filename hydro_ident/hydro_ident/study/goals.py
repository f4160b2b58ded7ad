"""What the study asks of a diagnosis, and whether a table of scores has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True, slots=True)
class Goal:
    """A figure of the study and what it should be.

    Attributes
    ----------
    text : str
    section : {"rates", "means", "numbers"}
        Of `Summary.content`.
    key : str
    least : bool
        Whether the bound is the least value, or the most.
    bound : float
    """

    text: str
    section: Literal["rates", "means", "numbers"]
    key: str
    least: bool
    bound: float

    def value(self, table: Mapping[str, Any]) -> float | None:
        """The measured figure; None where no case tells.

        `table` holds the study's figures.
        """
        entry = table[self.section].get(self.key)
        found = entry
        if entry is not None and self.section != "numbers":
            found = entry["share" if self.section == "rates" else "mean"]
        return None if found is None else float(found)

    def interval(self, table: Mapping[str, Any]) -> tuple[float, float] | None:
        """Its 95 % interval, where it has one.

        `table` holds the study's figures.
        """
        entry = table[self.section].get(self.key)
        if self.section == "numbers" or entry is None or entry["ci95"] is None:
            return None
        low, high = entry["ci95"]
        return float(low), float(high)

    def met(self, table: Mapping[str, Any]) -> bool | None:
        """Whether the measured figure, as it is, has the bound; None where there is none.

        `table` holds the study's figures.
        """
        value = self.value(table)
        if value is None:
            return None
        return value >= self.bound if self.least else value <= self.bound

    @property
    def bound_text(self) -> str:
        """The bound as the tables show it."""
        return f"{'>=' if self.least else '<='} {self.shown(self.bound)}"

    def shown(self, value: float | None) -> str:
        """A value of this figure as the tables show it."""
        if value is None:
            return "-"
        percent = self.section == "rates" or self.key.endswith("size_error")
        return f"{100.0 * value:.1f} %" if percent else f"{value:.3f}"


def _share(text: str, key: str, *, least: float) -> Goal:
    return Goal(text, "rates", key, True, least)


def _at_most(text: str, section: Literal["rates", "means", "numbers"], **most: float) -> Goal:
    ((key, bound),) = most.items()
    return Goal(text, section, key, False, bound)


#: Of the study's table; all but the first line of clean cases are of strong effects.
GOALS = (
    _share("detected", "detected", least=0.97),
    _share("right channel and joint", "right_channel", least=0.97),
    _share("true name in the set", "in_set", least=0.97),
    _at_most("mean size of the set, `excite` runs", "means", excite_set_size=1.5),
    _at_most(
        "mean size of the set less the oracle's, work cycles", "means", set_size_over_oracle=0.0
    ),
    _share("first name right where the set is one name", "first_where_alone", least=0.92),
    _at_most("clean recordings given any finding", "rates", clean_with_finding=0.01),
    _at_most("clean recordings given any unknown", "rates", clean_with_unknown=0.01),
    _at_most("outside the catalogue: given a wrong name", "rates", outside_wrong_name=0.02),
    _share("outside the catalogue: reported unknown", "outside_unknown", least=0.90),
    _share("... in a channel of it", "outside_unknown_there", least=0.90),
    _share("two or three effects: all in the sets", "several_all_in_sets", least=0.85),
    _at_most(
        "held-out residual over the fit with the true structure, mean", "means", heldout_ratio=1.05
    ),
    _at_most("size of the effect, median error", "numbers", median_size_error=0.10),
    _share("95 % interval of the size covers it", "size_covered", least=0.90),
)
