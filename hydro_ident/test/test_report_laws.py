"""Dependences without a name as a report draws them: as large as what is left, not larger."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch import residuals
from hydro_ident.mismatch.dependence import Dependence
from hydro_ident.mismatch.diagnosis import diagnose
from hydro_ident.mismatch.diagnosis_file import as_modelled
from hydro_ident.mismatch.locate import dependences
from hydro_ident.mismatch.outcome import UNKNOWN, Diagnosis
from hydro_ident.mismatch.residuals import Residuals
from hydro_ident.mismatch.unknown import Unexplained
from hydro_ident.report.diagnosis_views import law_views
from hydro_ident.report.law_section import LawView
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot

#: Name, length in s and seed of two runs of a machine.
RUNS = (("train", 40.0, 0), ("check", 15.0, 3))
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


def test_a_name_that_another_law_stands_for_is_drawn_on_the_rows_it_was_weighed_on(
    make_run: tuple[Callable[..., Robot], Callable[..., object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Long recordings are searched in parts: of fewer rows than are fitted in the end."""
    monkeypatch.setattr(residuals, "LONGEST_SCAN_S", 20.0)
    true_crane, simulated_run = make_run
    bristle = EffectSpec("presliding_friction", "lift_cylinder", {"force": 3e3, "distance": 4e-5})
    truth = replace(true_crane(), effects=(bristle,))
    bags = [simulated_run(truth, seconds, seed=s).recording(n) for n, seconds, s in RUNS]
    found = diagnose(load_robot("xs031"), bags[:1], bags[1:])
    assert found.work is not None
    assert found.work.scan.mask.size < found.work.training.mask.size
    (one,) = found.findings
    other = next(c for c in one.named.tried if c.term.effect.name == "coulomb_friction")
    named = replace(one.named, contenders=(other,), tried=(other,), probability=(1.0,))
    instead = replace(one, named=named)
    assert as_modelled(found, instead)[0] is not found.whole
    (view,) = law_views(replace(found, findings=(instead,)))
    assert view.law is not None
    assert view.left is not None
    assert view.x.shape == view.residual.shape == view.law.shape
    assert rms(view.left) < 0.3 * rms(view.residual)
