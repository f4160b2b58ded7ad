"""A valve's own noise drives the pressures: windows are long enough that it is no stiffness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_ident.mismatch.fitting import slowness
from hydro_ident.mismatch.rows.choices import Choices
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.simulation.simulate import simulate

STEP_S, SECONDS = 0.002, 60.0
MakeRun = tuple[Callable[..., Any], Callable[..., Any]]


@pytest.fixture(scope="module")
def runs(make_run: MakeRun) -> dict[str, Any]:
    """One motion, with valves that do as they are told and with ones that waver."""
    true_crane, simulated_run = make_run
    calm = simulated_run(true_crane(), SECONDS, scale=0.4)
    rng, keep = np.random.default_rng(5), np.exp(-STEP_S / 0.05)
    chance = lfilter(
        [np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=calm.voltage.shape), axis=0
    )
    time = STEP_S * np.arange(len(calm.q))
    out = simulate(true_crane(), time, calm.voltage + 0.03 * chance, calm.q[0])
    noise = rng.normal(0.0, 4.0e3, (2, *out.p_a.shape))
    wavering = replace(calm, q=out.q, p_a=out.p_a + noise[0], p_b=out.p_b + noise[1])
    return {"calm": calm, "wavering": wavering}


def _stiffness(work: Residuals, run: Any) -> list[float]:
    """Fitted bulk modulus over the true one, by cylinder."""
    cylinders = zip(work.base.model.robot.cylinders, run.robot.cylinders, strict=True)
    return [one.bulk_modulus_pa / true.bulk_modulus_pa for one, true in cylinders]


@pytest.mark.thorough
def test_a_calm_valve_leaves_the_windows_as_they_are(
    runs: dict[str, Any], lay_out: Callable[..., Residuals]
) -> None:
    work = lay_out(runs["calm"])
    assert work.training.predictor.material.windows.length_s == Choices().windows_s[0]
    assert not any("stiffer" in note for note in work.notes)
    assert _stiffness(work, runs["calm"]) == pytest.approx([1.0, 1.0], abs=0.02)


@pytest.mark.thorough
def test_a_wavering_valve_makes_oil_look_stiff_over_short_windows_only(
    runs: dict[str, Any], monkeypatch: pytest.MonkeyPatch, lay_out: Callable[..., Residuals]
) -> None:
    work = lay_out(runs["wavering"])
    monkeypatch.setattr(slowness, "LENGTHS_S", ())
    short = lay_out(runs["wavering"])
    length_s = work.training.predictor.material.windows.length_s
    assert length_s > short.training.predictor.material.windows.length_s
    assert any(f"over {length_s:.2g} s" in note for note in work.notes)
    off = {
        name: max(abs(np.log(_stiffness(one, runs["wavering"]))))
        for name, one in (("short", short), ("long", work))
    }
    assert min(_stiffness(short, runs["wavering"])) > 1.0
    assert off["long"] < 0.5 * off["short"]
