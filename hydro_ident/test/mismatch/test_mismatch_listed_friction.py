"""Listed Coulomb friction of a seal that bends before it slides: nothing was left out there."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.mismatch.answer.answering import answered, base_to_search
from hydro_ident.mismatch.fitting.as_listed import listed_effects
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.split.listed_friction import (
    bends_of_listed,
    bristle_notes,
    with_bristles,
)
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.robot import EffectSpec

Make = tuple[Callable[..., Any], Callable[..., Any]]
LIFT, FORCE_N = "lift_cylinder", 2500.0
LISTED = (EffectSpec("coulomb_friction", LIFT, {"force": 2000.0}),)


def _bending(make_run: Make, lay_out: Callable[..., Residuals], distance_m: float) -> Residuals:
    true_crane, simulated_run = make_run
    numbers = {"force": FORCE_N, "distance": distance_m}
    crane = replace(true_crane(), effects=(EffectSpec("presliding_friction", LIFT, numbers),))
    return lay_out(simulated_run(crane, 14.0), listed=LISTED)


@pytest.fixture(scope="module")
def bent(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """A crane whose lift's seal bends over a tenth of a millimetre."""
    return _bending(make_run, lay_out, 1.0e-4)


def test_what_is_listed_stands_as_a_bristle(bent: Residuals) -> None:
    (term,) = bent.base.model.terms
    assert (term.effect.name, term.target) == ("presliding_friction", LIFT)
    force, distance = term.parameters
    assert force == pytest.approx(FORCE_N, rel=0.02)
    assert distance == pytest.approx(1.0e-4, rel=0.15)
    (note,) = bristle_notes(bent.training, bent.base)
    said = re.fullmatch(rf"coulomb_friction of {LIFT}, .*, bends over (\S+) mm before .* N", note)
    assert said
    assert float(said[1]) == pytest.approx(0.1, rel=0.15)


@pytest.mark.thorough
def test_no_other_friction_is_found_beside_it(bent: Residuals) -> None:
    answer = answered(bent, base_to_search(bent))
    assert answer.names == set()
    assert not answer.unknown


@pytest.mark.thorough
def test_a_bend_that_the_base_does_not_show_is_none_once_it_is_found(bent: Residuals) -> None:
    """As where a load that is picked up hides it."""
    training, (bristle,) = bent.training, bent.base.model.terms
    (dry,) = listed_effects(training).values()
    rigid = fit(training, replace(bent.base.model, terms=(dry,)))
    assert bends_of_listed(training, [bristle, dry]) == [bristle]
    hidden = replace(bent, base=rigid)
    answer = answered(hidden, base_to_search(hidden))
    assert answer.names == set()
    assert [term.effect.name for term in answer.whole.model.terms] == ["presliding_friction"]


@pytest.fixture(scope="module")
def far(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """A crane whose lift's seal bends over a millimetre."""
    return _bending(make_run, lay_out, 1.0e-3)


def test_a_travel_that_is_no_dry_frictions_is_left_to_the_search(far: Residuals) -> None:
    (term,) = far.base.model.terms
    assert term.effect.name == "coulomb_friction"
    assert bristle_notes(far.training, far.base) == []


def test_what_stands_in_a_listed_laws_place_bends_no_further(
    bent: Residuals, far: Residuals
) -> None:
    """However much better a longer travel fits: that would be no listed dry friction."""
    (bristle,) = bent.base.model.terms
    begun = with_bristles(far.training, far.base, [bristle])
    longer = fit(far.training, begun.model, passes=8)
    (held,) = longer.model.terms
    assert held.parameters[1] == pytest.approx(3.0e-4, rel=1e-6)
    free = replace(held, effect=CATALOGUE["presliding_friction"])
    (term,) = fit(far.training, replace(longer.model, terms=(free,)), passes=8).model.terms
    assert term.parameters[1] == pytest.approx(1.0e-3, rel=0.1)
