"""What acts through the oil's compression alone is told where an edge's flaw would hide others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.mismatch.answer.confirmation import searched
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.slopes import start_at
from hydro_ident.mismatch.fitting.training import Training, start_model
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.rows.rests import moving_rows
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

Make = tuple[Callable[..., Robot], Callable[..., object]]


@pytest.mark.thorough
def test_twelve_millilitres_are_found(make_run: Make, lay_out: Callable[..., Residuals]) -> None:
    """Less than 0.025 % of the flow, which is what a balance is good for where edges err."""
    true_crane, simulated_run = make_run
    volumes = {"volume_a": 1.2e-5, "volume_b": 1.2e-5}
    effect = EffectSpec("dead_volume", "lift_cylinder", volumes)
    truth = replace(true_crane(), effects=(effect,))
    work = lay_out(simulated_run(truth, 18.0), [simulated_run(truth, 12.0, seed=5)])
    _, _, (found,), _ = searched(work, work.base)
    assert found.named.names == ("dead_volume",)
    assert found.named.term.target == "lift_cylinder"
    assert found.named.term.parameters == pytest.approx([1.2e-5, 1.2e-5], rel=0.05)


@pytest.mark.thorough
def test_air_is_in_the_dead_volume_too(
    make_run: Make, predictor_of: Callable[[Robot, Recording], Predictor]
) -> None:
    """Of a litre beyond the stroke with 2 % of air nothing is left, and each comes to its size."""
    true_crane, simulated_run = make_run
    hose = EffectSpec("dead_volume", "lift_cylinder", {"volume_a": 1e-3, "volume_b": 1e-3})
    air = EffectSpec("entrained_air", "lift_cylinder", {"fraction": 0.02})
    truth = replace(true_crane(), effects=(hose, air))
    run = simulated_run(truth, 12.0, noisy=False)
    predictor = predictor_of(truth, run.recording())
    start = start_model(truth, predictor, resolve(truth))
    model = replace(start, delays_s=(truth.command_delay_s,) * len(truth.cylinders))
    whole = predictor.residual(model)
    flows = [k for k, n in enumerate(predictor.material.channels) if n.startswith("lift/flow")]
    rows = np.isin(predictor.material.channel, flows)
    assert np.array_equal(start_at(predictor, model).residual, whole)
    for term in model.terms:
        rest = replace(model, terms=tuple(t for t in model.terms if t is not term))
        contribution = predictor.contribution(model, term)
        assert np.std(whole[rows]) < 0.01 * np.std(contribution[rows])
        left = predictor.residual(rest)
        assert left == pytest.approx(whole + contribution, rel=1e-6, abs=1e-9 * np.ptp(left))
    off = tuple(
        replace(t, parameters=np.array([0.7 * t.parameters[0], *t.parameters[1:]]))
        for t in model.terms
    )
    training = Training.of(predictor, moving_rows(predictor.material))
    found = fit(training, replace(model, terms=off), passes=6).model
    sizes = {t.effect.name: t.parameters for t in found.terms}
    assert sizes["dead_volume"] == pytest.approx([1e-3, 1e-3], rel=0.02)
    assert sizes["entrained_air"][0] == pytest.approx(0.02, rel=0.02)
