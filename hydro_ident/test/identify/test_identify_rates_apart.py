"""Recordings of several rates: each has the filters that it bears, none those of a slower one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import map_columns
from hydro_ident.identify.identification import Identification, Settings, identify
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")

EVERY = 50
TOLD = "few samples a second: motion is looked at below 4 Hz, forces below 1.6 Hz"


def _slow(recording: Recording) -> Recording:
    """The same at 10 samples a second."""
    thin = map_columns(recording, lambda values: values[::EVERY])
    return replace(thin, path=Path("slow"), period_s=EVERY * recording.period_s)


def _values(found: Identification) -> dict[str, tuple[float, float]]:
    return {p.name: (p.value, p.std) for p in found.parameters if p.identifiable}


def test_a_slow_recording_to_validate_on_changes_nothing_that_is_fitted(clean: Any) -> None:
    fast, robot = clean.recording(), load_robot("xs031")
    other = replace(fast, path=Path("other"))
    slow, same = (identify(robot, [fast], [one]) for one in (_slow(fast), other))
    assert slow.verdict == "identified"
    assert _values(slow) == _values(same)
    assert "tilt_link.mcx" in _values(slow)
    # What is scored passes slow filters on both sides: it is predicted as well.
    for score in slow.channels:
        if score.name.endswith("/force"):
            assert score.recordings == ("slow",)
            assert float(score.summary()["fit_after_pct"]) > 99.0
    assert [n[: len(TOLD) + 6] for n in slow.notes if "few samples" in n] == [f"slow: {TOLD}"]


def test_a_slow_recording_leaves_the_filters_of_the_others_alone(clean: Any) -> None:
    """Without valves, whose delays are looked for as far as the slow one's cycles reach."""
    fast, robot = clean.recording(valve_v=None, command_v=None), load_robot("xs031")
    both = identify(robot, [fast, _slow(fast)], settings=Settings(estimator="wls"))
    assert both.inertial is not None
    true = dict(zip(both.inertial.model.base.names, _true_base(both, clean), strict=True))
    found = _values(both)
    for name in ("lift_link.mcx", "lift_link.iyy", "tilt_link.mcx", "tilt_link.iyy"):
        assert found[name][0] == pytest.approx(true[name], rel=0.01)
    [note] = [n for n in both.notes if "few samples" in n]
    assert note.startswith(f"slow: {TOLD}")


def _true_base(found: Identification, run: Any) -> Any:
    assert found.inertial is not None
    return found.inertial.model.base.combination @ run.robot.parameter_vector
