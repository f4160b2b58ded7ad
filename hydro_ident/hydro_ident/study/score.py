"""Scores of diagnoses against what was hidden, case by case.

An effect counts as detected where a finding in one of its channels, or one whose set has its name,
is there. Its channel counts as right where the finding's first channel is one of them; its name
where it stands in the set of a finding that lists one of them at all. Every finding stands for at
most one effect, and those that stand for none are false.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from hydro_ident.study.sizes import found_interval, found_size

_TIMING = ("command_delay", "pressure_delay")


@dataclass(frozen=True, slots=True)
class EffectScore:
    """How one hidden effect fared.

    Attributes
    ----------
    name : str
    ratio : float
        Size over its limit of detection.
    detected : bool
    right_channel : bool
        The finding's first channel is one of the effect's.
    listed_channel : bool
        Any of its channels is.
    in_set, first : bool
        Its name, at a listed channel.
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
    listed_channel: bool
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
        Of processor time where the answer has it, else of wall time.
    ratio : float or None
        Smallest size over its limit of what is hidden, of the catalogue or not.
    effects : tuple of EffectScore
        Of the catalogue.
    false_names : tuple of str
        First names of findings that stand for none of what is hidden.
    unknown : bool
        Something is reported as unexplained.
    unknown_there : bool
        In a channel of what is hidden.
    heldout_excess : float or None
        Largest held-out error after the findings over its noise floor, of the effects' channels.
    heldout_ratio : float or None
        Largest held-out error over that of the fit with the true structure.
    oracle_set : int or None
        Size of the set that an oracle with the true structure cannot split.
    """

    case: str
    kind: str
    motion: str
    verdict: str
    exit: int
    findings: int
    seconds: float
    ratio: float | None = None
    effects: tuple[EffectScore, ...] = ()
    false_names: tuple[str, ...] = ()
    unknown: bool = False
    unknown_there: bool = False
    heldout_excess: float | None = None
    heldout_ratio: float | None = None
    oracle_set: int | None = None

    def content(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def score_case(
    truth: Mapping[str, Any],
    answer: Mapping[str, Any],
    oracle: Mapping[str, Any] | None = None,
) -> CaseScore:
    """Hold an answer against the truth.

    Parameters
    ----------
    truth : mapping
        As `generate.truth_record`.
    answer : mapping
        As `conceal.diagnose_case`.
    oracle : mapping, optional
        As `oracle.oracle_case`.
    """
    result = answer.get("result") or {}
    findings = list(result.get("findings", []))
    known = [effect for effect in truth["effects"] if effect["known"]]
    chosen = _matched(known, findings)
    effects = [_effect_score(effect, chosen.get(k)) for k, effect in enumerate(known)]
    used = list(chosen.values())
    everywhere = _of_the_whole_robot(known, result)
    others = [f["names"][0] for f in findings if f["names"] and not any(f is u for u in used)]
    false = [name for name in others if name not in everywhere]
    ratios = [float(e["ratio"]) for e in truth["effects"]]
    there = {str(u.get("channel", "")) for u in result.get("unexplained", [])}
    return CaseScore(
        case=str(truth["case"]),
        kind=str(truth["kind"]),
        motion=str(truth["motion"]),
        verdict=str(result.get("verdict", "none")),
        exit=int(answer["exit"]),
        findings=len(findings),
        seconds=float(answer.get("cpu_seconds") or answer["seconds"]),
        ratio=min(ratios, default=None),
        effects=tuple(effects),
        false_names=tuple(false),
        unknown=bool(result.get("unexplained")) or result.get("verdict") == "unknown",
        unknown_there=bool(there & _channels(truth)),
        heldout_excess=_excess(truth, result),
        heldout_ratio=_ratio(truth, result, oracle or {}),
        oracle_set=len(oracle["set"]) if oracle and oracle.get("set") else None,
    )


def _of_the_whole_robot(
    effects: Sequence[Mapping[str, Any]], result: Mapping[str, Any]
) -> set[str]:
    """Names of hidden effects that act on every joint: found at several, none is wrong."""
    joints = {str(channel).split("/")[0] for channel in result.get("channels", {})}
    return {str(e["name"]) for e in effects if e["target"] not in joints}


def _channels(truth: Mapping[str, Any]) -> set[str]:
    return {str(c) for effect in truth["effects"] for c in effect["channels"]}


def _right_places(effect: Mapping[str, Any]) -> set[str]:
    timing = {"timing"} if effect["name"] in _TIMING else set[str]()
    return timing | set(effect["channels"])


def _listed(effect: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    """Whether a finding lists a channel of an effect, first or not."""
    places = {str(finding["channel"]), *map(str, finding.get("also", []))}
    return bool(places & _right_places(effect))


def _matched(
    effects: Sequence[Mapping[str, Any]], findings: Sequence[Mapping[str, Any]]
) -> dict[int, Mapping[str, Any]]:
    """Which finding stands for which effect: with its name and place, its name, its place.

    Better matches come first, whichever effect they are of.
    """
    chosen: dict[int, Mapping[str, Any]] = {}
    free = list(findings)
    for by_name, by_place in ((True, True), (True, False), (False, True)):
        for k, effect in enumerate(effects):
            fits = [
                f
                for f in free
                if (effect["name"] in f["names"] or not by_name)
                and (_listed(effect, f) or not by_place)
            ]
            if k not in chosen and fits:
                chosen[k] = fits[0]
                free = [f for f in free if f is not fits[0]]
    return chosen


def _effect_score(effect: Mapping[str, Any], finding: Mapping[str, Any] | None) -> EffectScore:
    name, ratio = str(effect["name"]), float(effect["ratio"])
    if finding is None:
        nothing = (False, False, False, False, False)
        return EffectScore(name, ratio, *nothing, 0, 0.0, "", None, None)
    names = [str(n) for n in finding["names"]]
    chances = dict(zip(names, finding.get("probability", []), strict=False))
    parameters, at = list(finding.get("parameters", [])), effect["at"]
    listed = _listed(effect, finding)
    first = listed and bool(names) and names[0] == name
    size = found_size(name, parameters, at) if first else None
    covariance = finding.get("covariance")
    span = found_interval(name, parameters, at, covariance) if first else None
    true = float(effect["size"])
    return EffectScore(
        name=name,
        ratio=ratio,
        detected=True,
        right_channel=finding["channel"] in _right_places(effect),
        listed_channel=listed,
        in_set=listed and name in names,
        first=first,
        set_size=len(names),
        probability=float(chances.get(name, 0.0)),
        answer=names[0] if names else "",
        size_ratio=None if size is None else size / true,
        covered=None if span is None else span[0] <= true <= span[1],
    )


def _excess(truth: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    channels = result.get("channels", {})
    ratios = [
        channels[c]["rmse_after"] / channels[c]["noise_floor"]
        for c in sorted(_channels(truth))
        if channels.get(c, {}).get("noise_floor")
    ]
    return float(max(ratios)) if ratios else None


def _ratio(
    truth: Mapping[str, Any], result: Mapping[str, Any], oracle: Mapping[str, Any]
) -> float | None:
    """Largest held-out error over the oracle's, of the effects' channels."""
    channels, best = result.get("channels", {}), oracle.get("rmse", {})
    ratios = [
        channels[c]["rmse_after"] / best[c]
        for c in sorted(_channels(truth))
        if c in channels and best.get(c)
    ]
    return float(max(ratios)) if ratios else None
