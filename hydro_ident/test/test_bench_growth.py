"""Exponents of known numbers: what the growth of a command is called."""

from __future__ import annotations

from pathlib import Path

import pytest

from hydro_ident.bench import growth
from hydro_ident.bench.growth import FLAT, LINEAR, Grown, exponent_rows
from hydro_ident.study.peak import Spent


def _grown(seconds: tuple[float, ...], peaks: tuple[float, ...]) -> list[Grown]:
    return [Grown(10.0**k, s, p) for k, (s, p) in enumerate(zip(seconds, peaks, strict=True))]


def test_a_slow_start_does_not_hide_how_the_last_decade_grows() -> None:
    """Time 10 s + 0.01 s min^-2 t^2: over all lengths it seems to grow less than linearly."""
    grown = _grown((10.01, 11.0, 110.0), (100.0, 100.0, 200.0))
    whole, whole_peak, last, last_peak = exponent_rows("inspect", grown)
    assert whole.job == "inspect, a bag of 1 to 100 minutes: exponent of time"
    assert last.job == "inspect, a bag of 10 to 100 minutes: exponent of time"
    assert whole.ours == pytest.approx(0.5205, abs=1e-4)
    assert whole.met
    assert last.ours == pytest.approx(1.0)
    assert whole_peak.ours == pytest.approx(0.1505, abs=1e-4)
    assert last_peak.ours == pytest.approx(0.3010, abs=1e-4)
    assert (last.theirs, last_peak.theirs) == (LINEAR, FLAT)
    assert not last_peak.met


def test_of_one_decade_there_is_one_slope() -> None:
    time, peak = exponent_rows("player", _grown((2.0, 20.0), (80.0, 80.0)))
    assert time.job == "player, a bag of 1 to 10 minutes: exponent of processor time"
    assert time.ours == pytest.approx(1.0)
    assert peak.ours == pytest.approx(0.0)
    assert peak.met


def test_a_diagnosis_is_measured_up_to_ten_minutes_its_memory_against_linear(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, float]] = []

    def bag_of(minutes: float, folder: Path) -> Path:
        bag = folder / f"{minutes:g}"
        bag.mkdir()
        return bag

    def watched(command: str, bag: Path) -> Spent:
        minutes = float(bag.name)
        asked.append((command, minutes))
        return Spent(minutes, 100.0 * minutes**0.5, 0.0)

    monkeypatch.setattr(growth, "bag_of", bag_of)
    monkeypatch.setattr(growth, "watched", watched)
    passed = growth.Passed(dict.fromkeys(growth.LIVE, (1.0, 1.0)), 10, 10)
    monkeypatch.setattr(growth, "passed_on", lambda *_: passed)
    rows = {row.job: row for row in growth.growth_rows([1.0, 10.0, 100.0], tmp_path)}
    assert [minutes for command, minutes in asked if command == "diagnose"] == [1.0, 10.0]
    memory = rows["diagnose, a bag of 1 to 10 minutes: exponent of peak memory"]
    assert memory.ours == pytest.approx(0.5)
    assert (memory.peer, memory.met) == ("linear", True)
    assert rows["identify, a bag of 1 to 100 minutes: exponent of peak memory"].peer == "flat"
    assert "identify, a bag of 10 to 100 minutes: exponent of time" in rows
