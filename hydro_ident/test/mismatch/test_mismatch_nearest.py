"""What has no name tells which effect of the catalogue comes nearest to it."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.scoring import Score, score
from hydro_ident.mismatch.unnamed.nearest import with_nearest
from hydro_ident.mismatch.unnamed.unknown import Unexplained

EMPTY = np.zeros(0)


@pytest.fixture(scope="module")
def scanned(rubbing: Residuals) -> list[Score]:
    entries = rubbing.bank.entries(rubbing.base.model)
    mask = rubbing.training.mask
    return [s for e in entries if (s := score(rubbing.base.bench, e, mask)) is not None]


def _left_in(channel: str) -> Unexplained:
    one = Dependence(
        0, channel, "piston_velocity", "", 50.0, 8, 10.0, 5e-4, 0.5, 800.0, EMPTY, EMPTY, EMPTY
    )
    return Unexplained(channel, ("piston_velocity",), 0.5, 5e-4, "half of it has no name", one)


def test_a_friction_that_nothing_confirmed_is_told_where_it_is(
    rubbing: Residuals, scanned: list[Score]
) -> None:
    """Not in the tilt joint, where the same trials leave what they find."""
    given = [_left_in("lift/force"), _left_in("tilt/force")]
    lift, tilt = with_nearest(rubbing.scan, rubbing.base, scanned, given)
    begin, _, told = lift.text.partition("; ")
    assert begin == given[0].text
    assert "friction of lift_cylinder comes nearest" in told
    assert told.endswith("could not be confirmed")
    assert tilt == given[1]


def test_what_stands_in_the_model_is_not_told_again(
    rubbing: Residuals, scanned: list[Score]
) -> None:
    best = max(scanned, key=lambda s: s.value)
    term = best.entry.trial.at(best.coefficients)
    whole = fit(rubbing.training, rubbing.base.model.with_term(term))
    (one,) = with_nearest(rubbing.scan, whole, scanned, [_left_in("lift/force")])
    assert f"{term.effect.name} of" not in one.text
