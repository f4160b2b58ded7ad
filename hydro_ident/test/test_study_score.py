"""Scores of made-up answers, whose right figures are known by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.errors import IdentError
from hydro_ident.study.conceal import ANSWERS, TRUTHS, write_json
from hydro_ident.study.goals import GOALS
from hydro_ident.study.intervals import Rate, rate
from hydro_ident.study.page import BEGIN, END, with_tables
from hydro_ident.study.planting import KNOWN
from hydro_ident.study.publish import publish, summary_text
from hydro_ident.study.score import score_case
from hydro_ident.study.summary import shuffled, summarise


def _effect(name: str, *, ratio: float = 5.0, channels: Any = ("lift/force",)) -> dict[str, Any]:
    return {
        "name": name,
        "known": name in KNOWN,
        "target": "lift",
        "size": 1000.0,
        "limit": 1000.0 / ratio,
        "ratio": ratio,
        "channels": list(channels),
        "at": {},
    }


def _truth(*effects: dict[str, Any], kind: str = "single", case: str = "a") -> dict[str, Any]:
    return {"case": case, "kind": kind, "motion": "excite", "effects": list(effects)}


def _finding(
    *names: str, channel: str = "lift/force", value: float = 1050.0, also: Any = ()
) -> dict[str, Any]:
    chances = [0.9, *[0.1 / max(len(names) - 1, 1)] * (len(names) - 1)]
    parameter = {"name": f"{names[0]}.force", "value": value, "std": 40.0, "unit": "N"}
    return {
        "channel": channel,
        "also": list(also),
        "names": list(names),
        "probability": chances[: len(names)],
        "parameters": [parameter],
    }


def _answer(*findings: dict[str, Any], unexplained: Any = (), code: int = 0) -> dict[str, Any]:
    result = {"verdict": "explained", "findings": list(findings), "unexplained": list(unexplained)}
    return {"exit": code, "seconds": 10.0, "error": "", "result": result if code == 0 else None}


def test_right_answer() -> None:
    score = score_case(
        _truth(_effect("coulomb_friction")),
        _answer(_finding("coulomb_friction", "pin_friction")),
    )
    (effect,) = score.effects
    assert effect.detected
    assert effect.right_channel
    assert effect.in_set
    assert effect.first
    assert effect.set_size == 2
    assert effect.probability == pytest.approx(0.9)
    assert effect.size_ratio == pytest.approx(1.05)
    assert effect.covered
    assert score.false_names == ()


def test_wrong_name_in_the_right_place_is_detected_not_named() -> None:
    score = score_case(_truth(_effect("pin_friction")), _answer(_finding("coulomb_friction")))
    (effect,) = score.effects
    assert effect.detected
    assert effect.right_channel
    assert not effect.in_set
    assert not effect.first
    assert effect.size_ratio is None
    assert effect.answer == "coulomb_friction"


def test_right_name_in_the_wrong_place_is_not_the_right_channel() -> None:
    finding = _finding("coulomb_friction", channel="tilt/force")
    (effect,) = score_case(_truth(_effect("coulomb_friction")), _answer(finding)).effects
    assert effect.detected
    assert not any((effect.in_set, effect.first, effect.right_channel, effect.listed_channel))
    beside = _finding("coulomb_friction", channel="tilt/force", also=["lift/force"])
    (effect,) = score_case(_truth(_effect("coulomb_friction")), _answer(beside)).effects
    assert effect.in_set
    assert effect.listed_channel
    assert not effect.right_channel


def test_timing_counts_for_delays_only() -> None:
    late = _effect("command_delay", channels=["lift/flow_a"])
    (effect,) = score_case(
        _truth(late), _answer(_finding("command_delay", channel="timing"))
    ).effects
    assert effect.right_channel
    rub = _truth(_effect("coulomb_friction"))
    (effect,) = score_case(rub, _answer(_finding("coulomb_friction", channel="timing"))).effects
    assert not effect.right_channel


def test_each_finding_stands_for_one_effect() -> None:
    truth = _truth(
        _effect("coulomb_friction"),
        _effect("internal_leakage", channels=["lift/flow_a", "lift/flow_b"]),
        kind="double",
    )
    only = score_case(truth, _answer(_finding("coulomb_friction")))
    assert [e.in_set for e in only.effects] == [True, False]
    both = score_case(
        truth,
        _answer(
            _finding("internal_leakage", channel="lift/flow_b"),
            _finding("coulomb_friction"),
            _finding("backlash", channel="tilt/force"),
        ),
    )
    assert [e.in_set for e in both.effects] == [True, True]
    assert both.false_names == ("backlash",)


def test_outside_effects_are_unknown_or_wrongly_named() -> None:
    truth = _truth(_effect("bearing_ripple"), kind="outside")
    good = score_case(truth, _answer(unexplained=[{"channel": "lift/force"}]))
    assert good.unknown
    assert good.false_names == ()
    bad = score_case(truth, _answer(_finding("coulomb_friction")))
    assert not bad.unknown
    assert bad.false_names == ("coulomb_friction",)


def test_no_answer_at_all() -> None:
    score = score_case(_truth(_effect("coulomb_friction")), _answer(code=1))
    assert score.exit == 1
    assert not score.effects[0].detected
    assert score.verdict == "none"


def test_table_of_hand_made_cases() -> None:
    scores = [
        score_case(_truth(kind="clean"), _answer()),
        score_case(_truth(kind="clean"), _answer(_finding("backlash"))),
        score_case(_truth(_effect("coulomb_friction")), _answer(_finding("coulomb_friction"))),
        score_case(_truth(_effect("pin_friction")), _answer(_finding("coulomb_friction"))),
        score_case(_truth(_effect("pin_friction", ratio=0.5)), _answer()),
        score_case(_truth(_effect("valve_hum"), kind="outside"), _answer(unexplained=[{}])),
    ]
    table = summarise(scores)
    assert table.cases == {"clean": 2, "single": 3, "outside": 1}
    assert table.rates["clean_with_finding"] == Rate(1, 2)
    assert table.rates["detected"] == Rate(2, 2)
    assert table.rates["in_set"] == Rate(1, 2)
    assert table.rates["first_where_alone"] == Rate(1, 2)
    assert table.rates["below_limit_detected"] == Rate(0, 1)
    assert table.rates["outside_unknown"] == Rate(1, 1)
    assert table.rates["outside_wrong_name"] == Rate(0, 1)
    assert table.means["set_size"].value == 1.0
    assert table.confusion["pin_friction"] == {"coulomb_friction": 1}
    assert table.confusion["(outside)"] == {"unknown": 1}


def test_a_better_match_is_not_taken_by_another_effect() -> None:
    """Two frictions of one cylinder, one of them found: it stands for the one that it names."""
    truth = _truth(_effect("coulomb_friction"), _effect("quadratic_friction"), kind="double")
    score = score_case(truth, _answer(_finding("quadratic_friction")))
    assert [e.detected for e in score.effects] == [False, True]
    assert score.false_names == ()
    only_place = score_case(truth, _answer(_finding("pin_friction")))
    assert [e.detected for e in only_place.effects] == [True, False]
    assert not only_place.effects[0].in_set


def test_weak_effects_outside_the_catalogue_are_counted_apart() -> None:
    strong = _truth(_effect("valve_hum", ratio=9.0), kind="outside")
    weak = _truth(_effect("valve_hum", ratio=0.7), kind="outside")
    there = {"channel": "lift/force"}
    table = summarise(
        [
            score_case(strong, _answer(unexplained=[there])),
            score_case(strong, _answer(_finding("backlash"), unexplained=[{"channel": "x"}])),
            score_case(weak, _answer()),
        ]
    )
    assert table.rates["outside_unknown"] == Rate(2, 2)
    assert table.rates["outside_unknown_there"] == Rate(1, 2)
    assert table.rates["outside_wrong_name"] == Rate(1, 2)
    assert table.rates["outside_weak_unknown"] == Rate(0, 1)


def test_the_oracle_stands_beside() -> None:
    truth = {**_truth(_effect("coulomb_friction")), "motion": "work"}
    answer = _answer(_finding("coulomb_friction", "pin_friction", "backlash"))
    answer["result"]["channels"] = {
        "lift/force": {"rmse_after": 106.0, "noise_floor": 50.0},
        "tilt/force": {"rmse_after": 900.0, "noise_floor": 50.0},
    }
    oracle = {"rmse": {"lift/force": 100.0, "tilt/force": 100.0}, "set": ["a", "b"]}
    score = score_case(truth, answer, oracle)
    assert score.heldout_ratio == pytest.approx(1.06)
    assert score.oracle_set == 2
    table = summarise([score])
    assert table.means["heldout_ratio"].value == pytest.approx(1.06)
    assert table.rates["heldout_within"] == Rate(0, 1)
    assert table.means["set_size_over_oracle"].value == 1.0
    assert table.rates["first_where_oracle_alone"] == Rate(0, 0)
    assert score_case(truth, answer).heldout_ratio is None


def test_goals_are_held_against_the_table() -> None:
    table = summarise(
        [
            score_case(_truth(kind="clean"), _answer()),
            score_case(_truth(_effect("coulomb_friction")), _answer(_finding("coulomb_friction"))),
            score_case(_truth(_effect("pin_friction")), _answer(_finding("coulomb_friction"))),
        ]
    ).content()
    met = {goal.key: goal.met(table) for goal in GOALS}
    assert met["detected"]
    assert met["clean_with_finding"]
    assert met["in_set"] is False
    assert met["median_size_error"]
    assert met["outside_unknown"] is None
    for goal in GOALS:
        assert goal.key in table[goal.section], goal.key


@pytest.fixture
def published(tmp_path: Path) -> dict[str, Any]:
    """A study of three cases with answers made up, published."""
    truths = [
        _truth(kind="clean", case="a"),
        _truth(_effect("coulomb_friction"), case="b"),
        _truth(_effect("valve_hum", channels=["lift/flow_a"]), kind="outside", case="c"),
    ]
    guess = {"verdict": "explained", "findings": [_finding("coulomb_friction")], "seconds": 0.1}
    for truth in truths:
        found = [_finding("coulomb_friction")] if truth["case"] == "b" else []
        answer = {**_answer(*found), "baselines": {"always_coulomb": guess}, "secluded": True}
        write_json(tmp_path / TRUTHS / f"{truth['case']}.json", truth)
        write_json(tmp_path / ANSWERS / f"{truth['case']}.json", answer)
    plan = {"cases": 3, "seed": 4, "frozen": None}
    return publish(tmp_path, ["a", "b", "c"], plan)


def test_baselines_are_scored_by_the_same_rules(published: dict[str, Any]) -> None:
    own, coulomb = published["table"]["rates"], published["baselines"]["always_coulomb"]["rates"]
    assert own["in_set"]["share"] == coulomb["in_set"]["share"] == 1.0
    assert (own["clean_with_finding"]["hits"], coulomb["clean_with_finding"]["hits"]) == (0, 1)
    assert (own["outside_wrong_name"]["hits"], coulomb["outside_wrong_name"]["hits"]) == (0, 1)
    assert published["baselines"]["greedy_bic"]["rates"]["detected"]["hits"] == 0
    assert published["secluded"] == rate([True] * 3).content()
    assert published["command"] == "study --cases 3 --seed 4"
    assert "detected" in summary_text(published)


def test_page_shows_the_published_figures(published: dict[str, Any], tmp_path: Path) -> None:
    results = tmp_path / "results"
    page = f"before {BEGIN} old {END} after"
    assert "No run has been published" in with_tables(page, results)
    write_json(results / "study_tuning.json", published)
    write_json(results / "study.json", published)
    text = with_tables(page, results)
    assert "| detected | >= 97.0 % | 1/1, 100.0 % [2.5 %, 100.0 %] | met |" in text
    assert "| outside the catalogue: reported unknown | >= 90.0 % | 0/1, 0.0 %" in text
    assert "not met" in text
    assert "| coulomb_friction | coulomb_friction 1 |" in text
    assert with_tables(text, results) == text
    with pytest.raises(IdentError, match="expected the marks '<!-- study results"):
        with_tables("no place", results)


def test_shuffled_labels_score_at_chance() -> None:
    """Perfect answers held against other cases' truths are right as often as names agree."""
    random = np.random.default_rng(3)
    names = random.choice(["coulomb_friction", "dead_volume", "valve_deadband", "backlash"], 400)
    places = {"coulomb_friction": "lift/force", "backlash": "tilt/force"}
    truths, answers = [], []
    for k, name in enumerate(names):
        place = places.get(str(name), "lift/flow_a")
        truths.append(_truth(_effect(str(name), channels=[place]), case=str(k)))
        answers.append(_answer(_finding(str(name), channel=place)))
    right = summarise([score_case(t, a) for t, a in zip(truths, answers, strict=True)])
    assert right.rates["first"] == Rate(400, 400)
    dealt = shuffled(truths, 1)
    assert [t["case"] for t in dealt] == [t["case"] for t in truths]
    chance = summarise([score_case(t, a) for t, a in zip(dealt, answers, strict=True)])
    share = chance.rates["first"].share
    assert share is not None
    assert 0.18 < share < 0.32
