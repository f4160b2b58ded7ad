"""What two looks at held-out rows say of a finding together."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.answer.diagnosis import _verdict
from hydro_ident.mismatch.answer.notes import left_notes
from hydro_ident.mismatch.answer.outcome import ChannelResult
from hydro_ident.mismatch.answer.spoilt import _spoils
from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.split.held_out import STANDS
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.verifying.judging import judged, unpredicted, vague
from hydro_ident.mismatch.verifying.looks import SHOWN, Look
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

#: A fit of nothing: no number of it has a deviation.
UNFITTED = Weighed(None, (), np.zeros((0, 0)), np.zeros(0))  # type: ignore[arg-type]
NOT_TOLD = "held-out rows exercise it and cannot tell it from nothing"


@pytest.fixture
def named(robot: Robot) -> Named:
    listed = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 100.0})
    (term,) = resolve(replace(robot, effects=(listed,)))
    one = Contender(term, UNFITTED, 400.0, 380.0, 3.0)
    return named_of([one], 0.0005, 1.0)


def _look(p_value: float, shown: float) -> Look:
    return Look(p_value, 0.0, 0.0, shown, ({"lift/force": 2.0}, {"lift/force": 1.0}), "")


@pytest.mark.parametrize(
    ("p_value", "shown", "against"),
    [
        (0.5 * STANDS, 4.0 * SHOWN, ""),
        # They should hardly show it and do, as one in eighty of what is nothing does.
        (0.5 * STANDS, 0.5 * SHOWN, NOT_TOLD),
        # More of it is there, and plainly.
        (0.05 * STANDS, 0.5 * SHOWN, ""),
    ],
)
def test_what_held_out_rows_should_hardly_show_takes_more_than_luck(
    named: Named, p_value: float, shown: float, against: str
) -> None:
    looks = [_look(p_value, shown), _look(p_value, shown)]
    assert judged(looks, named, met=True) == (looks[0], False, against)
    # Where they do not exercise it, its own recording speaks for it, and leaves no doubt here.
    assert judged(looks, named, met=False)[1:] == (True, "")


@pytest.mark.parametrize(
    ("after", "said"),
    [
        ((1.02, 2.1), "are predicted worse with it (rmse +2.0%)"),
        # In one of its channels they are not, or not by more than what wavers.
        ((1.005, 2.1), ""),
        ((1.02, 1.0), ""),
    ],
)
def test_what_a_refit_alone_gains_by_is_no_prediction(
    after: tuple[float, float], said: str
) -> None:
    names = ("lift/force", "tilt/force")
    sides = dict(zip(names, (1.0, 2.0), strict=True)), dict(zip(names, after, strict=True))
    one = replace(_look(1e-4, 100.0), sides=sides)
    assert unpredicted(one, names, silent=False).endswith(said)
    assert not unpredicted(one, ["lift/flow_a"], silent=False)


def test_what_nobody_sees_in_the_prediction_is_not_saved_by_a_refit() -> None:
    """Of rows that do not exercise it nothing is expected."""
    one = replace(_look(1e-4, 100.0), unseen=True)
    said = "held-out rows of lift/force are predicted no better with it"
    assert unpredicted(one, ["lift/force"], silent=False) == said
    assert not unpredicted(one, ["lift/force"], silent=True)


@pytest.mark.parametrize(
    ("p_value", "silent"),
    [
        # In favour, and no more likely by chance than a true one of that size would have it.
        (0.005, True),
        # As nothing at all would have it.
        (0.6, False),
    ],
)
def test_what_instants_cost_does_not_deny_a_finding(
    named: Named, p_value: float, silent: bool
) -> None:
    """124 of them make of p = 0.005 in favour one half and more."""
    faint = replace(_look(p_value, 12.0), instants=124)
    other = replace(_look(0.005 if silent else 0.7, 30.0), instants=124)
    _, quiet, against = judged([faint, other], named, met=True)
    assert quiet is silent
    assert against == ("" if silent else "held-out rows are not predicted better with it (p = 1)")
    # Where it stands by these rows alone they are paid for.
    plain = replace(_look(1e-5, 100.0), instants=124)
    assert judged([plain, plain], named, met=True) == (plain, False, "")
    assert plain.paid == pytest.approx(1.24e-3)


@pytest.mark.parametrize(
    ("p_value", "silent", "after", "said"),
    [
        (1e-4, False, 1.0, ""),
        (1e-2, False, 1.0, "show it but faintly"),
        (1e-4, False, 3.0, "gain nothing by it"),
        (1e-4, True, 1.0, "hardly exercise it"),
    ],
)
def test_a_size_that_is_not_told_takes_rows_that_show_it_plainly(
    p_value: float, silent: bool, after: float, said: str
) -> None:
    look = replace(_look(p_value, 100.0), sides=({"lift/force": 2.0}, {"lift/force": after}))
    size = "inertance is 1 +- 4"
    against = vague(look, silent, ["lift/force"], size)
    assert against == (said and f"held-out rows {said}, and its size is not told: {size}")
    assert not vague(look, silent, ["lift/force"], "")


def test_channels_whose_sensors_make_no_noise_divide_nothing() -> None:
    """A constant, coarsely read: a floor of 0."""
    rows = np.ones(5)
    quiet, other = (
        ChannelResult(name, "N", rows, rows, 0.0 * rows, 0.0 * rows, floor)
        for name, floor in (("a/force", 0.0), ("b/force", 1e-3))
    )
    (note,) = left_notes([quiet, other])
    assert "b/force 1e+03" in note
    assert "a/force" not in note
    floors = {"a/force": 0.0, "b/force": 2.0}
    assert not _spoils({"a/force": (1.0, 9.0), "b/force": (2.0, 1.0)}, floors, ["a/force"])
    assert _spoils({"a/force": (9.0, 1.0), "b/force": (1.0, 2.0)}, floors, ["a/force", "b/force"])


@pytest.mark.parametrize(
    ("noise", "idle", "verdict"),
    [(0.9, False, "matches"), (0.5, False, "no_improvement"), (0.5, True, "matches")],
)
def test_where_nothing_but_noise_is_left_there_is_nothing_to_improve(
    noise: float, idle: bool, verdict: str
) -> None:
    at = np.arange(1000.0)
    wave, left = 100.0 * np.sin(at), np.where(at % 2.0, 1.0, -1.0)
    channel = ChannelResult("tilt/flow_b", "m^3/s", at, wave, wave, wave - left, noise)
    refused: Any = SimpleNamespace(
        channels=("tilt/flow_b",), verification=SimpleNamespace(idle=idle)
    )
    assert _verdict((), [refused], [channel], (), False) == verdict
