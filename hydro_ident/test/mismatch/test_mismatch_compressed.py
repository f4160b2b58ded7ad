"""What acts through the oil's compression alone is told where an edge's flaw would hide others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from hydro_ident.mismatch.confirmation import searched
from hydro_ident.mismatch.residuals import Residuals
from hydro_model.robot import EffectSpec, Robot

Make = tuple[Callable[..., Robot], Callable[..., object]]


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
