"""A late valve whose spool the robot file lists: the spool's frequency does not hide it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.answer.answering import answered, base_to_search
from hydro_ident.mismatch.answer.odd_valve import held_to_others, odd_valve
from hydro_ident.mismatch.fitting.as_listed import as_listed_notes, listed_effects
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.naming.lags import lag_s
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot

Make = tuple[Callable[..., Robot], Callable[..., object]]
OWN_S, LATER_S = 0.001, 0.005
LIFT, TILT = 0, 1
LATE = EffectSpec("command_delay", "tilt_valve", {"delay": LATER_S})


def _spool(joint: str, hz: float) -> EffectSpec:
    return EffectSpec("valve_spool_lag", f"{joint}_valve", {"frequency": hz, "damping": 0.9})


LISTED = _spool("lift", 60.0), _spool("tilt", 75.0)


def _tilt_spool(whole: Fitted) -> ActiveEffect:
    terms = whole.model.terms
    (spool,) = (t for t in terms if (t.effect.name, t.cylinder) == ("valve_spool_lag", TILT))
    return spool


@pytest.fixture(scope="module")
def late(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """Spools as listed, and the tilt's commands 5 ms later than the lift's."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), command_delay_s=OWN_S, effects=(*LISTED, LATE))
    return lay_out(simulated_run(truth, 12.0), listed=LISTED)


@pytest.fixture(scope="module")
def half_listed(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """As `late`, and nobody has looked up the spools' damping."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), command_delay_s=OWN_S, effects=(*LISTED, LATE))
    listed = [
        replace(one, parameters={"frequency": one.parameters["frequency"]}) for one in LISTED
    ]
    return lay_out(simulated_run(truth, 12.0), listed=tuple(listed))


@pytest.fixture(scope="module")
def slow(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """The tilt's spool slower than listed, and nothing else."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), command_delay_s=OWN_S, effects=(LISTED[0], _spool("tilt", 20.0)))
    return lay_out(simulated_run(truth, 20.0), listed=LISTED)


@pytest.mark.thorough
def test_a_delay_that_the_listed_spool_had_taken_up_is_named(late: Residuals) -> None:
    assert not any("tilt_cylinder" in kept for kept in late.training.as_listed)
    answer = answered(late, base_to_search(late))
    assert answer.names == {("command_delay", TILT)}
    (finding,) = answer.findings
    assert finding.named.term.parameters[0] == pytest.approx(LATER_S, rel=0.1)
    assert list(_tilt_spool(answer.whole).parameters) == [75.0, 0.9]


@pytest.mark.thorough
def test_a_damping_that_the_file_leaves_out_does_not_take_it_up_where_it_is_held(
    half_listed: Residuals,
) -> None:
    """With a damping of its own a spool of 75 Hz is as late as one of a fifth of that."""
    held = held_to_others(half_listed, half_listed.base, TILT)
    now = {(t.effect.name, t.target): list(t.parameters) for t in held.base.model.terms}
    for key, listed in listed_effects(held.training).items():
        assert now[key] == list(listed.parameters)
    assert not any("damping" in note for note in as_listed_notes(held.base, held.training))


@pytest.mark.thorough
def test_a_spool_that_is_slower_than_listed_stays_one(slow: Residuals) -> None:
    """A number that is far from the file's is no finding, and no delay is told for it."""
    answer = answered(slow, base_to_search(slow))
    assert answer.names == set()
    assert odd_valve(answer.work.training, answer.whole) == TILT
    late_s = lag_s(_tilt_spool(answer.whole)) + answer.whole.model.delays_s[TILT]
    assert late_s == pytest.approx(OWN_S + 0.9 / (np.pi * 20.0), rel=0.03)
