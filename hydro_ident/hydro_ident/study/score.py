"""Scores of diagnoses against what was hidden: case by case, then over all cases.

An effect counts as detected where a finding in one of its channels, or one whose set has its name,
is there; its name counts where it stands in the set of such a finding. Strong effects are those of
three times their limit of detection and more: the goals are stated for them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from hydro_ident.study.intervals import Rate, rate
from hydro_ident.study.sizes import found_interval, found_size

STRONG = 3.0
_TIMING = ("command_delay", "pressure_delay")
#: A size counts as right within this share.
_SIZE_SHARE = 0.10


@dataclass(frozen=True, slots=True)
class EffectScore:
    """How one hidden effect fared.

    Attributes
    ----------
    name : str
    ratio : float
        Size over its limit of detection.
    detected, right_channel, in_set, first : bool
    set_size : int
        Of the finding with its name, or of the nearest one; 0 where there is none.
    probability : float
        Given to its name.
    answer : str
        First name of the finding that stands for it, or empty.
    size_ratio : float or None
        Size found over size hidden.
    covered : bool or None
        The 95 % interval of the size holds the true one.
    """

    name: str
    ratio: float
    detected: bool
    right_channel: bool
    in_set: bool
    first: bool
    set_size: int
    probability: float
    answer: str
    size_ratio: float | None
    covered: bool | None


@dataclass(frozen=True, slots=True)
class CaseScore:
    """How a case fared.

    Attributes
    ----------
    case, kind, motion, verdict : str
    exit, findings : int
    seconds : float
    effects : tuple of EffectScore
    false_names : tuple of str
        First names of findings that stand for none of what is hidden.
    unknown : bool
        Something is reported as unexplained.
    heldout_excess : float or None
        Largest held-out error after the findings over its noise floor, of the effects' channels.
    """

    case: str
    kind: str
    motion: str
    verdict: str
    exit: int
    findings: int
    seconds: float
    effects: tuple[EffectScore, ...] = ()
    false_names: tuple[str, ...] = ()
    unknown: bool = False
    heldout_excess: float | None = None

    def content(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def score_case(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> CaseScore:
    """Hold an answer against the truth.

    Parameters
    ----------
    truth : mapping
        As `generate.truth_record`.
    answer : mapping
        As `conceal.diagnose_case`.
    """
    result = answer.get("result") or {}
    findings = list(result.get("findings", []))
    effects, used = [], set[int]()
    for effect in truth["effects"]:
        if not effect["known"]:
            continue
        chosen = _finding_for(effect, findings, used)
        if chosen is not None:
            used.add(chosen)
        effects.append(_effect_score(effect, None if chosen is None else findings[chosen]))
    false = [f["names"][0] for i, f in enumerate(findings) if i not in used and f["names"]]
    return CaseScore(
        case=str(truth["case"]),
        kind=str(truth["kind"]),
        motion=str(truth["motion"]),
        verdict=str(result.get("verdict", "none")),
        exit=int(answer["exit"]),
        findings=len(findings),
        seconds=float(answer["seconds"]),
        effects=tuple(effects),
        false_names=tuple(false),
        unknown=bool(result.get("unexplained")) or result.get("verdict") == "unknown",
        heldout_excess=_excess(truth, result),
    )


def _places(finding: Mapping[str, Any]) -> set[str]:
    return {str(finding["channel"]), *map(str, finding.get("also", []))}


def _right_place(effect: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    places = set(effect["channels"])
    if effect["name"] in _TIMING:
        places.add("timing")
    return bool(places & _places(finding))


def _finding_for(
    effect: Mapping[str, Any], findings: Sequence[Mapping[str, Any]], used: set[int]
) -> int | None:
    """The finding that stands for an effect: with its name and place, its name, its place."""
    free = [i for i in range(len(findings)) if i not in used]
    for wanted in ((True, True), (True, False), (False, True)):
        for i in free:
            named = effect["name"] in findings[i]["names"]
            placed = _right_place(effect, findings[i])
            if (named or not wanted[0]) and (placed or not wanted[1]):
                return i
    return None


def _effect_score(effect: Mapping[str, Any], finding: Mapping[str, Any] | None) -> EffectScore:
    name, ratio = str(effect["name"]), float(effect["ratio"])
    if finding is None:
        return EffectScore(name, ratio, False, False, False, False, 0, 0.0, "", None, None)
    names = [str(n) for n in finding["names"]]
    chances = dict(zip(names, finding.get("probability", []), strict=False))
    parameters, at = list(finding.get("parameters", [])), effect["at"]
    first = bool(names) and names[0] == name
    size = found_size(name, parameters, at) if first else None
    span = found_interval(name, parameters, at) if first else None
    true = float(effect["size"])
    return EffectScore(
        name=name,
        ratio=ratio,
        detected=True,
        right_channel=_right_place(effect, finding),
        in_set=name in names,
        first=first,
        set_size=len(names),
        probability=float(chances.get(name, 0.0)),
        answer=names[0] if names else "",
        size_ratio=None if size is None else size / true,
        covered=None if span is None else span[0] <= true <= span[1],
    )


def _excess(truth: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    channels = result.get("channels", {})
    wanted = {c for effect in truth["effects"] for c in effect["channels"]}
    ratios = [
        channels[c]["rmse_after"] / channels[c]["noise_floor"]
        for c in sorted(wanted)
        if channels.get(c, {}).get("noise_floor")
    ]
    return float(max(ratios)) if ratios else None


@dataclass(slots=True)
class Summary:
    """Scores over all cases, as they are published.

    Attributes
    ----------
    cases : dict of str to int
        Number by kind.
    rates : dict of str to Rate
    numbers : dict of str to float or None
    confusion : dict of str to dict of str to int
        True name, then answered first name, of strong single effects.
    """

    cases: dict[str, int] = field(default_factory=dict)
    rates: dict[str, Rate] = field(default_factory=dict)
    numbers: dict[str, float | None] = field(default_factory=dict)
    confusion: dict[str, dict[str, int]] = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "cases": self.cases,
            "rates": {name: value.content() for name, value in self.rates.items()},
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
    clean = [s for s in scores if s.kind == "clean"]
    outside = [s for s in scores if s.kind == "outside"]
    several = [s for s in scores if s.kind in ("double", "triple")]
    known = [s for s in scores if s.effects]
    out.rates["finished"] = rate([s.exit == 0 for s in scores])
    out.rates["clean_with_finding"] = rate([s.findings > 0 for s in clean])
    out.rates["clean_with_unknown"] = rate([s.unknown for s in clean])
    out.rates["outside_wrong_name"] = rate([bool(s.false_names) for s in outside])
    out.rates["outside_unknown"] = rate([s.unknown for s in outside])
    whole = [s for s in several if all(e.ratio >= strong for e in s.effects)]
    out.rates["several_all_in_sets"] = rate([all(e.in_set for e in s.effects) for s in whole])
    out.rates["false_extra_name"] = rate([bool(s.false_names) for s in known])
    bands = {"": (strong, np.inf), "below_limit": (0.0, 1.0), "1_to_3": (1.0, strong)}
    for label, (low, high) in bands.items():
        picked = [e for s in known for e in s.effects if low <= e.ratio < high]
        _effect_rates(out, picked, f"{label}_" if label else "")
    for motion in ("excite", "work"):
        picked = [e for s in known if s.motion == motion for e in s.effects if e.ratio >= strong]
        _effect_rates(out, picked, f"{motion}_")
    out.numbers["median_seconds"] = _median([s.seconds for s in scores])
    out.numbers["slowest_seconds"] = max((s.seconds for s in scores), default=None)
    out.numbers["median_heldout_over_floor"] = _median(
        [s.heldout_excess for s in known if s.heldout_excess is not None]
    )
    out.confusion = _confusion(scores, strong)
    return out


def _effect_rates(out: Summary, picked: Sequence[EffectScore], prefix: str) -> None:
    out.rates[f"{prefix}detected"] = rate([e.detected for e in picked])
    out.rates[f"{prefix}right_channel"] = rate([e.right_channel for e in picked])
    out.rates[f"{prefix}in_set"] = rate([e.in_set for e in picked])
    # The data can tell where the answer is one name alone.
    alone = [e for e in picked if e.set_size == 1]
    out.rates[f"{prefix}first_where_alone"] = rate([e.first for e in alone])
    out.rates[f"{prefix}first"] = rate([e.first for e in picked])
    sized = [e for e in picked if e.size_ratio is not None]
    out.rates[f"{prefix}size_within"] = rate(
        [abs((e.size_ratio or 0.0) - 1.0) <= _SIZE_SHARE for e in sized]
    )
    out.rates[f"{prefix}size_covered"] = rate(
        [bool(e.covered) for e in picked if e.covered is not None]
    )
    sets = [float(e.set_size) for e in picked if e.in_set]
    out.numbers[f"{prefix}mean_set_size"] = float(np.mean(sets)) if sets else None


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _confusion(scores: Sequence[CaseScore], strong: float) -> dict[str, dict[str, int]]:
    table: dict[str, Counter[str]] = {}
    for s in scores:
        if s.kind == "single" and s.effects[0].ratio >= strong:
            effect = s.effects[0]
            answer = effect.answer or ("unknown" if s.unknown else "nothing")
            table.setdefault(effect.name, Counter())[answer] += 1
        elif s.kind == "outside":
            answer = s.false_names[0] if s.false_names else ""
            answer = answer or ("unknown" if s.unknown else "nothing")
            table.setdefault("(outside)", Counter())[answer] += 1
    return {name: dict(sorted(row.items())) for name, row in sorted(table.items())}


def shuffled(truths: Sequence[Mapping[str, Any]], seed: int) -> list[Mapping[str, Any]]:
    """Truths dealt out to other cases: what a diagnosis scores by chance."""
    order = np.random.default_rng(seed).permutation(len(truths))
    return [{**truths[int(j)], "case": truths[i]["case"]} for i, j in enumerate(order)]
