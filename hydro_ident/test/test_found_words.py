"""A lag that is damped beyond 1 is told by where its slower pole is."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.commands.diagnose import _finding_lines
from hydro_ident.report.diagnosis_report import _other_law
from hydro_ident.report.diagnosis_verdict import _size
from hydro_ident.report.found_words import corners
from hydro_ident.report.model_parameters import finding_rows

LAG = "valve_spool_lag"


def _finding(frequency: float, damping: float) -> dict[str, Any]:
    """A spool's lag whose frequency and damping are vague, and go hand in hand."""
    size = np.array([frequency, damping])
    # The corner alone is known, to 1 %; along it both are off by five times themselves.
    along, across = 5.0 * size, 0.005 * size * [1.0, -1.0]
    covariance = np.outer(along, along) + np.outer(across, across)
    names = [f"{LAG}.frequency", f"{LAG}.damping"]
    std = np.sqrt(np.diag(covariance))
    return {
        "names": [LAG],
        "probability": [1.0],
        "channel": "lift/flow_a",
        "target": "lift_cylinder",
        "where": {"text": "at some valve rate"},
        "modelled_as": LAG,
        "equation": "u'' = ...",
        "parameters": [
            {"name": n, "value": v, "std": s, "unit": u}
            for n, v, s, u in zip(names, size.tolist(), std.tolist(), ("Hz", "1"), strict=True)
        ],
        "covariance": {"names": names, "values": covariance.tolist()},
        "heldout_rmse_before": None,
        "heldout_rmse_after": None,
    }


def test_the_corner_lags_as_the_lag_does_in_slow_motion() -> None:
    frequency, damping, slow = 24.42, 2.544, 0.3
    (corner,) = corners(_finding(frequency, damping))
    ratio = slow / frequency
    phase = math.atan2(2.0 * damping * ratio, 1.0 - ratio**2)
    assert math.atan(slow / corner["value"]) == pytest.approx(phase, rel=2e-3)
    assert corner["std"] == pytest.approx(0.01 * corner["value"], rel=1e-3)
    assert corner["unit"] == "Hz"


def test_one_that_may_ring_is_told_by_its_own_numbers() -> None:
    assert corners(_finding(24.4, 0.9)) == []
    data = _finding(24.4, 2.5)
    assert corners(data | {"parameters": data["parameters"][:1]}) == []
    (unfitted,) = corners(data | {"covariance": {"names": [], "values": []}})
    assert unfitted["std"] is None


def test_the_table_has_the_law_that_stands_in_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    named = {"name": "coulomb_friction.force", "value": 4074.0, "std": 200.0, "unit": "N"}
    data = _finding(1.0, 0.5) | {
        "names": ["coulomb_friction", "presliding_friction"],
        "modelled_as": "presliding_friction", "parameters": [named], "equation": "tanh",
    }  # fmt: skip
    own = {
        "equation": "bristles", "covariance": {"names": [], "values": []},
        "parameters": [named | {"name": "presliding_friction.force", "value": 4075.3}],
    }  # fmt: skip
    monkeypatch.setattr("hydro_ident.report.model_parameters.finding_dict", lambda *_: data)
    monkeypatch.setattr("hydro_ident.report.model_parameters.law_of_model", lambda *_: own)
    (row,) = finding_rows(SimpleNamespace(), None, {})  # type: ignore[arg-type]
    assert (row.name, row.value) == ("presliding friction: force", 4075.3)
    assert row.below == (
        "lift cylinder; bristles; in the model for what is named Coulomb friction"
    )
    assert _other_law(data, "presliding_friction") == [
        ("its numbers, not in model.yaml", "force 4074 N"),
        ("law in model.yaml", "presliding friction"),
    ]
    assert _other_law(data | own, "presliding_friction") == [
        ("law in model.yaml", "presliding friction")
    ]


def test_text_and_report_give_it(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {"heldout_rmse_before": 2.0, "heldout_rmse_after": 1.0, "heldout_exercised": True}
    data = _finding(24.42, 2.544) | seen
    for module in ("mismatch.answer.diagnosis_file", "report.model_parameters"):
        monkeypatch.setattr(f"hydro_ident.{module}.finding_dict", lambda *_: data)
    # Its unit is known of the fitted rows where those to verify on lack the channel.
    fitted = SimpleNamespace(name=data["channel"], unit="m^3/s")
    found: Any = SimpleNamespace(channels=(), fitted=(fitted,))
    lines = _finding_lines(found, None)  # type: ignore[arg-type]
    assert any(line.endswith("2 -> 1 m^3/s with it") for line in lines)
    assert sum(line.endswith("no larger than its error") for line in lines) == 2
    (told,) = [line for line in lines if "/ (2 damping)" in line]
    assert told.startswith(f"    {LAG}.frequency / (2 damping) = 4.7995 +- 0.048 Hz: ")
    rows = finding_rows(found, None, {})  # type: ignore[arg-type]
    assert rows[-1].value == pytest.approx(4.7995, rel=1e-4)
    low, high = rows[-1].interval or (0.0, 0.0)
    assert high - low == pytest.approx(2 * 1.96 * 0.048, rel=1e-2)
    assert not rows[-1].off
    assert _size(data) == " (corner 4.8 Hz)"
