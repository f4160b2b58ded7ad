"""Dependences without a name as a report draws them: as large as what is left, not larger."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.dependence import Dependence
from hydro_ident.mismatch.locate import dependences
from hydro_ident.mismatch.outcome import UNKNOWN, Diagnosis
from hydro_ident.mismatch.residuals import Residuals
from hydro_ident.mismatch.unknown import Unexplained
from hydro_ident.report.diagnosis_views import law_views
from hydro_ident.report.law_section import LawView
from hydro_model.robot import EffectSpec, FloatArray, Robot

DEADBAND = EffectSpec("valve_deadband", "tilt_valve", {"width": 0.02})


@pytest.fixture(scope="module")
def sticking(
    make_run: tuple[Callable[..., Robot], Callable[..., object]], lay_out: Callable[..., Residuals]
) -> Residuals:
    """A machine whose tilt valve has a dead zone that its model does not have."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), effects=(DEADBAND,)), 18.0))


@pytest.fixture(scope="module")
def located(sticking: Residuals) -> list[Dependence]:
    return dependences(sticking.training, sticking.base)


def drawn(work: Residuals, found: Sequence[Dependence]) -> list[LawView]:
    """Dependences as the report of a diagnosis that found no names draws them."""
    names = work.training.predictor.material.channels
    unknown = tuple(
        Unexplained(names[d.channel], (d.variable,), d.share, d.p_value, "", d) for d in found
    )
    return law_views(
        Diagnosis(UNKNOWN, work.robot, None, unexplained=unknown, work=work, whole=work.base)
    )


def rms(values: FloatArray | None) -> float:
    assert values is not None
    return float(np.sqrt(np.mean(values**2)))


def test_a_drawn_law_has_the_size_and_the_share_that_its_text_says(
    sticking: Residuals, located: list[Dependence]
) -> None:
    assert {"direction", "valve_signal", ""} <= {d.times for d in located}
    assert any(d.period for d in located)
    for d, view in zip(located, drawn(sticking, located), strict=True):
        # Lines are fitted to rows that are weighed alike, and drawn by the channel's own weights.
        within = 1e-2 if d.period else 1e-9
        assert rms(view.law) == pytest.approx(d.size, rel=within), view.title
        assert rms(view.law) < 1.1 * rms(view.residual), view.title
        if d.share > 0.0:
            left = 1.0 - (rms(view.left) / rms(view.residual)) ** 2
            assert left == pytest.approx(d.share, abs=within), view.title


def test_what_the_base_swallows_of_a_law_is_not_drawn(
    sticking: Residuals, located: list[Dependence]
) -> None:
    """The edges' flows and the compression are a chamber's rate of volume."""
    d = next(
        one
        for one in located
        if (one.variable, one.times, one.period) == ("piston_velocity", "", 0.0)
        and sticking.training.predictor.material.is_flow(one.channel)
    )
    (alone,) = drawn(sticking, [d])
    large = 20.0 * rms(alone.residual) / rms(alone.x)
    (more,) = drawn(sticking, [replace(d, coefficients=d.coefficients + large * d.knots)])
    assert rms(more.law) < 1.1 * rms(more.residual)
    assert more.law == pytest.approx(alone.law, abs=1e-2 * rms(alone.law))
