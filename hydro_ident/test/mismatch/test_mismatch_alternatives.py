"""What a set of names keeps from being looked for, and what a rough fit knows too little of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.mismatch.naming.contenders import behind
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.name import _places, _sibling
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.candidates import trials
from hydro_ident.mismatch.trials.contender import Contender
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

Made = tuple[Callable[..., Any], Callable[..., Any]]
LAGGING = EffectSpec("valve_spool_lag", "lift_valve", {"frequency": 50.0, "damping": 0.6})


def test_only_what_stands_for_a_set_keeps_others_away_from_its_target(
    laid_crane: Residuals,
) -> None:
    """What a set could not tell from its first name may be there as well as that."""
    work = laid_crane
    wanted = ("valve_underlap", "valve_gain_nonlinearity", "valve_spool_lag", "command_delay")
    every = list(trials(work.training.predictor, work.base.model, wanted))
    at_lift = {t.name: t for t in every if t.target == "lift_cylinder"}
    at_tilt = {t.name: t for t in every if t.target == "tilt_cylinder"}
    assert set(at_lift) == set(at_tilt) == set(wanted)
    pair = [
        Contender(at_lift[name].active, work.base.weighed, gain, gain, 4.0)
        for name, gain in (("valve_underlap", 500.0), ("valve_gain_nonlinearity", 499.0))
    ]
    found = named_of(pair, 0.001, 1.0)
    assert found.names == ("valve_underlap", "valve_gain_nonlinearity")
    assert _sibling(at_lift["valve_underlap"], _places([found]))
    assert not _sibling(at_lift["valve_gain_nonlinearity"], _places([found]))
    assert not _sibling(at_tilt["valve_underlap"], _places([found]))
    lag = Contender(at_lift["valve_spool_lag"].active, work.base.weighed, 9.0, 9.0, 4.0)
    assert _sibling(at_lift["command_delay"], _places([named_of([lag], 0.001, 1.0)]))


@pytest.mark.thorough
def test_one_valve_that_is_late_is_no_delay_of_all(
    lay_out: Callable[..., Residuals], make_run: Made
) -> None:
    """To first order a delay of all makes a prompt valve so much early; none can be."""
    true_crane, simulated_run = make_run
    work = lay_out(simulated_run(replace(true_crane(), effects=(LAGGING,)), 16.0))
    delay = {"delay": 0.004}
    specs = (
        LAGGING,
        replace(LAGGING, parameters={"frequency": 70.0, "damping": 0.9}),
        EffectSpec("command_delay", "lift_valve", delay),
        EffectSpec("command_delay", "xs031", delay),
    )
    terms = [resolve(replace(load_robot("xs031"), effects=(one,)))[0] for one in specs]
    lag, _, late, all_late = Contest(work.training).fitted(work.base, terms, work.base.bench.noise)
    assert late.gain > 0.95 * lag.gain
    assert all_late.gain < 0.5 * lag.gain


@pytest.mark.parametrize("bound", [(), (3,)])
def test_what_a_rough_fit_knows_too_little_of_takes_no_place_of_others(
    bound: tuple[int, ...],
) -> None:
    gains = {0: 10.0, 1: 9.0, 2: 8.5, 3: 9.5, 4: 1.0}
    assert sorted(behind(gains, bound)) == ([4] if bound else [2, 4])
