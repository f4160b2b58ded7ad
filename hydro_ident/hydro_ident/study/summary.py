"""Scores over all cases: rates with intervals, and the goals that they are held against.

Strong effects are those of three times their limit of detection and more: the goals are stated for
them. Weaker ones are counted apart.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hydro_ident.study.intervals import Mean, Rate, mean, rate
from hydro_ident.study.score import CaseScore, EffectScore

STRONG = 3.0
#: A size counts as right within this share.
SIZE_SHARE = 0.10
#: Held-out error over that of the fit with the true structure.
HELD_OUT = 1.05


@dataclass(slots=True)
class Summary:
    """Scores over all cases, as they are published.

    Attributes
    ----------
    cases : dict of str to int
        Number by kind.
    rates : dict of str to Rate
    means : dict of str to Mean
    numbers : dict of str to float or None
    confusion : dict of str to dict of str to int
        True name, then answered first name, of strong single effects.
    """

    cases: dict[str, int] = field(default_factory=dict)
    rates: dict[str, Rate] = field(default_factory=dict)
    means: dict[str, Mean] = field(default_factory=dict)
    numbers: dict[str, float | None] = field(default_factory=dict)
    confusion: dict[str, dict[str, int]] = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "cases": self.cases,
            "rates": {name: value.content() for name, value in self.rates.items()},
            "means": {name: value.content() for name, value in self.means.items()},
            "numbers": self.numbers,
            "confusion": self.confusion,
        }


def summarise(scores: Sequence[CaseScore], strong: float = STRONG) -> Summary:
    """All figures of the study.

    Parameters
    ----------
    scores : sequence of CaseScore
    strong : float
        Ratio of size to limit from which an effect counts as strong.
    """
    out = Summary(cases=dict(Counter(s.kind for s in scores)))
    known = [s for s in scores if s.effects]
    out.rates["finished"] = rate([s.exit == 0 for s in scores])
    _without_names(out, scores, strong)
    whole = [s for s in known if s.kind != "single" and min(e.ratio for e in s.effects) >= strong]
    out.rates["several_all_in_sets"] = rate([all(e.in_set for e in s.effects) for s in whole])
    out.rates["false_extra_name"] = rate([bool(s.false_names) for s in known])
    bands = {"": (strong, np.inf), "below_limit": (0.0, 1.0), "1_to_3": (1.0, strong)}
    for label, (low, high) in bands.items():
        picked = [e for s in known for e in s.effects if low <= e.ratio < high]
        _effect_rates(out, picked, f"{label}_" if label else "")
    for motion in ("excite", "work"):
        picked = [e for s in known if s.motion == motion for e in s.effects if e.ratio >= strong]
        _effect_rates(out, picked, f"{motion}_")
    _beside_the_oracle(out, known, strong)
    out.numbers["median_seconds"] = _median([s.seconds for s in scores])
    out.numbers["slowest_seconds"] = max((s.seconds for s in scores), default=None)
    out.numbers["median_heldout_over_floor"] = _median(
        [s.heldout_excess for s in known if s.heldout_excess is not None]
    )
    out.confusion = _confusion(scores, strong)
    return out


def _without_names(out: Summary, scores: Sequence[CaseScore], strong: float) -> None:
    """Cases of which no name is right: clean ones, and effects of no catalogue."""
    clean = [s for s in scores if s.kind == "clean"]
    # One that broke down has not said that nothing is wrong.
    out.rates["clean_with_finding"] = rate([s.findings > 0 or s.exit != 0 for s in clean])
    out.rates["clean_with_unknown"] = rate([s.unknown or s.exit != 0 for s in clean])
    outside = [s for s in scores if s.kind == "outside"]
    for label, picked in (
        ("outside", [s for s in outside if (s.ratio or 0.0) >= strong]),
        ("outside_weak", [s for s in outside if (s.ratio or 0.0) < strong]),
    ):
        out.rates[f"{label}_wrong_name"] = rate(
            [bool(s.false_names) or s.exit != 0 for s in picked]
        )
        out.rates[f"{label}_unknown"] = rate([s.unknown for s in picked])
        out.rates[f"{label}_unknown_there"] = rate([s.unknown_there for s in picked])


def _effect_rates(out: Summary, picked: Sequence[EffectScore], prefix: str) -> None:
    for name in ("detected", "right_channel", "listed_channel", "in_set", "first"):
        out.rates[f"{prefix}{name}"] = rate([getattr(e, name) for e in picked])
    # The data can tell where the answer is one name alone.
    alone = [e for e in picked if e.set_size == 1]
    out.rates[f"{prefix}first_where_alone"] = rate([e.first for e in alone])
    sized = [e.size_ratio for e in picked if e.size_ratio is not None]
    out.rates[f"{prefix}size_within"] = rate([abs(s - 1.0) <= SIZE_SHARE for s in sized])
    error = _median([abs(s - 1.0) for s in sized])
    out.numbers[f"{prefix}median_size_error"] = error
    out.rates[f"{prefix}size_covered"] = rate(
        [bool(e.covered) for e in picked if e.covered is not None]
    )
    out.means[f"{prefix}set_size"] = mean([float(e.set_size) for e in picked if e.detected])


def _beside_the_oracle(out: Summary, known: Sequence[CaseScore], strong: float) -> None:
    """What is compared with a fit that was told the true structure."""
    told = [s for s in known if min(e.ratio for e in s.effects) >= strong]
    ratios = [s.heldout_ratio for s in told if s.heldout_ratio is not None]
    out.means["heldout_ratio"] = mean(ratios)
    out.rates["heldout_within"] = rate([r <= HELD_OUT for r in ratios])
    out.numbers["median_heldout_ratio"] = _median(ratios)
    pairs = [
        (s.effects[0], s.oracle_set)
        for s in told
        if s.kind == "single" and s.motion == "work" and s.oracle_set is not None
    ]
    found = [(e, size) for e, size in pairs if e.detected]
    out.means["oracle_set_size"] = mean([float(size) for _, size in found])
    out.means["set_size_beside_oracle"] = mean([float(e.set_size) for e, _ in found])
    out.means["set_size_over_oracle"] = mean([float(e.set_size - size) for e, size in found])
    alone = [e for e, size in pairs if size == 1]
    out.rates["first_where_oracle_alone"] = rate([e.first for e in alone])


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _confusion(scores: Sequence[CaseScore], strong: float) -> dict[str, dict[str, int]]:
    table: dict[str, Counter[str]] = {}
    for s in scores:
        if (s.ratio or 0.0) < strong or s.kind not in ("single", "outside"):
            continue
        name, answer = "(outside)", s.false_names[0] if s.false_names else ""
        if s.effects:
            name, answer = s.effects[0].name, s.effects[0].answer or answer
            if s.effects[0].detected and not s.effects[0].listed_channel:
                answer += " (elsewhere)"
        answer = answer or ("unknown" if s.unknown else "nothing")
        table.setdefault(name, Counter())[answer] += 1
    return {name: dict(sorted(row.items())) for name, row in sorted(table.items())}


def shuffled(truths: Sequence[Mapping[str, Any]], seed: int) -> list[Mapping[str, Any]]:
    """Truths dealt out to other cases: what a diagnosis scores by chance."""
    order = np.random.default_rng(seed).permutation(len(truths))
    return [{**truths[int(j)], "case": truths[i]["case"]} for i, j in enumerate(order)]
