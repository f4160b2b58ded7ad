"""The strip of a diagnosis: plain words at the top, formulas and definitions below."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hydro_ident.identify.verdict import recorded_as_others
from hydro_ident.mismatch.answer.outcome import (
    EXPLAINED,
    MATCHES,
    PARTLY,
    UNKNOWN,
    ChannelResult,
    Diagnosis,
)
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.forms import KINDS
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.state_space import UNITS
from hydro_ident.mismatch.unnamed.describe import Form, Value, form_text
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.report.channel_rows import ChannelRows, channel_rows
from hydro_ident.report.diagnosis_verdict import _experiments, _next, diagnosis_verdict
from hydro_ident.report.unnamed_words import in_words, unnamed_part
from hydro_ident.report.verdict_words import DRIVE
from hydro_model.robot_files import load_robot

NONE = np.zeros(0)
ROBOT = load_robot("xs031")
LIFT = ChannelWords(ROBOT, "lift/force")
TEXT = "24% of what is left in lift/force follows joint_angle (44 N rms, repeats); no effect"
#: What a reader of the strip should not have to read.
NOTATION = re.compile(r"cos\(|tanh|exp\(|\^|_|\+-|\bpi\b|e-\d\d")


def unnamed(
    variable: str = "joint_angle", times: str = "", period: float = 0.0, form: Form | None = None
) -> Unexplained:
    """A dependence of the lift's force."""
    curve = Dependence(
        0, "lift/force", variable, times, 40.0, 2, 6.0, 1e-4, 0.24, 44.2,
        np.array([0.1, 0.9]), np.zeros(2), np.zeros(2), period,
    )  # fmt: skip
    return Unexplained("lift/force", (variable,), 0.24, 1e-4, TEXT, curve, form, confirmed=True)


RIPPLE = Form(
    "cosine", "62.5 cos(2 pi q / 0.204 rad - 0.0539) N, q = joint_angle in rad", "joint_angle",
    (Value("amplitude", 62.53, 3.1, "N"), Value("phase", -0.0539, 0.05, "rad"),
     Value("period", 0.2042, 0.001, "rad")),
    0.98, 1.37, 1e-3, NONE, NONE,
)  # fmt: skip


def diagnosis(verdict: str, *found: Unexplained, **more: object) -> Diagnosis:
    channel = ChannelResult("lift/force", "N", NONE, NONE, NONE, NONE, 30.0)
    return Diagnosis(verdict, ROBOT, None, unexplained=found, channels=(channel,), **more)  # type: ignore[arg-type]


def held_out(before: float) -> list[ChannelRows]:
    summary = {"rmse_before": before, "rmse_after": before, "noise_floor": 30.0}
    return [channel_rows(("lift/force", "N"), (NONE,) * 4, (None, "", ""), summary)]


def card(found: Diagnosis, head: str, before: float = 1970.0) -> tuple[str, ...]:
    return dict(diagnosis_verdict(found, held_out(before)).cards)[head]


def test_what_repeats_is_told_in_words_and_its_formula_below() -> None:
    found = diagnosis(UNKNOWN, unnamed(period=0.2042, form=RIPPLE))
    strip = " ".join(card(found, "What was left out"))
    assert strip.startswith(
        "24 % of what is left in lift/force repeats every 0.204 rad (11.7°) of the lift joint, by"
        " about 63 N either way; no effect of the catalogue stands for it"
    )
    assert not NOTATION.search(strip)
    below = unescape(re.sub(r"<[^>]+>", "", unnamed_part(found)))
    for said in (
        "62.5 cos(2 pi q / 0.204 rad - 0.0539) N",
        "amplitude 62.5 ± 3.1 N",
        "98 % of what a free curve through the same rows does, on held-out rows 137 %"
        " (above 100 %: better than that curve)",
    ):
        assert said in below
    assert "+-" not in below


@pytest.mark.parametrize("kind", [kind.name for kind in KINDS])
@pytest.mark.parametrize("times", ["", "direction", "valve_signal", "compression", "velocity"])
def test_every_form_has_words(kind: str, times: str) -> None:
    shape = next(k.shape for k in KINDS if k.name == kind)
    values = (
        Value("amplitude" if kind == "cosine" else "coefficient", 62.5, 3.0, "N"),
        *((Value(shape, 0.3, None, "rad"),) if shape else ()),
    )
    form = replace(RIPPLE, name=kind, values=values)
    said = in_words(unnamed(times=times, form=form), "N", LIFT)
    assert said.startswith("24 % of what is left in lift/force ")
    assert not NOTATION.search(said)
    assert "None" not in said


@pytest.mark.parametrize("variable", [name for name in UNITS if name != "everywhere"])
def test_every_variable_has_words(variable: str) -> None:
    for period in (0.0, 0.3):
        said = in_words(unnamed(variable, period=period), "N", LIFT)
        assert not NOTATION.search(said)
        assert "44 N rms" in said


def test_flows_are_told_in_litres_per_minute_too() -> None:
    one = unnamed("piston_position", "compression", 0.0588)
    one = replace(one, channel="lift/flow_b", dependence=replace(one.dependence, size=5.73e-6))
    said = in_words(one, "m^3/s", ChannelWords(ROBOT, one.channel))
    assert "repeats every 0.0588 m of the lift piston, in proportion to the compression" in said
    assert "about 5.7e-6 m³/s rms (0.344 l/min)" in said


def test_what_follows_nothing_is_told_as_that() -> None:
    for text in (
        "what is left in lift/force is 37 times what the sensors' noise leaves and nothing that"
        " was recorded tells why; piston_velocity comes nearest, with 8% of it",
        "something in lift/force comes and goes: coulomb_friction resembles it on the average",
    ):
        said = in_words(replace(unnamed(), text=text), "N", LIFT)
        assert "follows the" not in said
        assert not NOTATION.search(said)


@pytest.mark.parametrize("verdict", [UNKNOWN, PARTLY, EXPLAINED])
def test_the_strip_never_says_both_that_something_is_missing_and_nothing_differs(
    verdict: str,
) -> None:
    (said,) = card(diagnosis(verdict), "What differs", before=42.0)
    assert said.startswith("No channel is off by more than 2 times sensor noise")
    assert "at most 1.4 times, lift/force" in said
    assert "still follows a pattern" in said
    (said,) = card(diagnosis(MATCHES), "What differs", before=42.0)
    assert said == "Nothing beyond what sensor noise leaves."


def test_errors_of_the_strip_say_of_what_they_are() -> None:
    first, second = card(diagnosis(UNKNOWN, unnamed()), "What differs")
    assert first == (
        "Before anything is added to the model, by the root mean square error over all held-out"
        " rows:"
    )
    assert second == "lift/force is off by 1970 N, 66 times sensor noise alone."


def test_a_bag_of_another_robot_is_told_before_all_else_that_is_sure() -> None:
    robot = load_robot("xs031")
    recording = SimpleNamespace(path=Path("run"), robot=robot, other_robot="mh26")
    (said,) = recorded_as_others([recording])  # type: ignore[list-item]
    first, *rest = card(diagnosis(UNKNOWN, unnamed(), notes=("any", said)), "How sure")
    assert first.startswith("Run was recorded as robot 'mh26', not xs031: ")
    assert rest == list(card(diagnosis(UNKNOWN, unnamed()), "How sure"))


def test_a_model_found_in_another_robots_bag_is_not_to_be_driven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told = {"names": ["coulomb_friction"], "probability": [0.99]}
    monkeypatch.setattr(
        "hydro_ident.report.diagnosis_verdict.finding_dict", lambda *_finding: told
    )
    term = SimpleNamespace(effect=SimpleNamespace(name="coulomb_friction"))
    robot, finding = load_robot("xs031"), SimpleNamespace(named=SimpleNamespace(term=term))
    other = SimpleNamespace(path=Path("run"), robot=robot, other_robot="mh26")
    notes = tuple(recorded_as_others([other]))  # type: ignore[list-item]
    for said, driven in (((), True), (notes, False)):
        found = diagnosis(EXPLAINED, findings=(finding,), notes=said)
        assert (DRIVE in _next(found)) == driven


def test_the_formula_of_the_terminal_stays_the_packages_own() -> None:
    assert "+- 3.1 N" in form_text(RIPPLE)


def test_an_experiment_is_told_once_with_its_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine joints with the same two names had made the same sentence nine times."""
    told = {
        "names": ["coulomb_friction", "presliding_friction"],
        "probability": [0.5, 0.5],
        "separating_experiment": "short reversals",
    }
    monkeypatch.setattr("hydro_ident.report.diagnosis_verdict.finding_dict", lambda *_: told)
    found = Diagnosis(EXPLAINED, ROBOT, None)
    at = [SimpleNamespace(named=SimpleNamespace(term=SimpleNamespace(target=t))) for t in "ab"]
    (line,) = _experiments(replace(found, findings=tuple(at)))  # type: ignore[arg-type]
    assert line == "To tell Coulomb friction from presliding friction (a, b): short reversals."
