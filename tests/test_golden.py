"""Golden bags through the real controller core and the real diagnosis, field by field.

`scripts/golden.sh --update` writes the references anew, where a change of theirs is meant.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import RECORDING_TOPICS, recording_of
from hydro_ident.errors import IdentError
from hydro_ident.study.golden.__main__ import KINDS, run
from hydro_ident.study.golden.bags import CONTROL_BAG, ROBOT, make_control_bag
from hydro_ident.study.golden.compare import differences
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[1]
GOLDEN = ROOT / "tests" / "golden"


def _expected(kind: str) -> Any:
    return json.loads((GOLDEN / f"{kind}.json").read_text(encoding="utf-8"))


def test_every_kind_is_replayed() -> None:
    assert set(KINDS) == {"control", "diagnosis"}


@pytest.mark.parametrize(
    "kind", ["control", pytest.param("diagnosis", marks=pytest.mark.thorough)]
)
def test_replays_are_as_committed(kind: str) -> None:
    # By the command: which kernels OpenBLAS takes is decided when a process loads it.
    done = subprocess.run(
        ["bash", str(ROOT / "scripts" / "golden.sh"), kind],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, f"{kind}: as expected\n"), done.stderr


def test_the_references_are_worth_comparing_with() -> None:
    control, diagnosis = _expected("control"), _expected("diagnosis")
    for one in control.values():
        assert one["counts"]["answered"] == 750
        assert one["counts"]["faults"] == one["counts"]["refused"] == 0
        volts = np.array([row["voltage_v"] for row in one["answers"]])
        assert np.all(np.ptp(volts, axis=0) > 0.5)
    adapted = np.array([row["estimates"] for row in control["adapting"]["answers"]])
    assert np.all(np.ptp(adapted, axis=0) > 0.0)
    assert diagnosis["verdict"] == "explained"
    found = {one["channel"]: one["names"] for one in diagnosis["findings"]}
    assert set(found) == {"tilt/force", "lift/flow_a"}
    assert "coulomb_friction" in found["tilt/force"]
    assert found["lift/flow_a"] == ["valve_deadband"]


def test_the_control_bag_comes_from_its_seed(tmp_path: Path) -> None:
    make_control_bag(tmp_path / CONTROL_BAG)
    robot = load_robot(ROBOT)
    made, kept = (
        recording_of(read_bag(folder / CONTROL_BAG, RECORDING_TOPICS), robot)
        for folder in (tmp_path, GOLDEN)
    )
    assert np.array_equal(made.stamp_ns, kept.stamp_ns)
    for name in ("q", "p_a", "p_b", "valve_v"):
        # Counts of the encoders and the pressures' may fall to the next one.
        span = np.ptp(getattr(kept, name), axis=0)
        assert np.all(np.abs(getattr(made, name) - getattr(kept, name)) <= 1e-3 * span)


def test_golden_files_are_small() -> None:
    sizes = [path.stat().st_size for path in GOLDEN.rglob("*") if path.is_file()]
    assert sum(sizes) < 1_000_000


@pytest.mark.parametrize(
    ("expected", "found", "said"),
    [
        ({"a": [1.0, 2.0]}, {"a": [1.0, 2.0 + 1e-6]}, "a[1]: expected 2.0, found 2.000001"),
        ({"a": [1.0]}, {"a": [1.0, 2.0]}, "a: expected 1 entries, found 2"),
        ({"a": 1}, {}, "a: expected it, found none"),
        ({}, {"b": 1}, "b: expected none, found it"),
        ({"a": {"b": "x"}}, {"a": {"b": "y"}}, "a.b: expected 'x', found 'y'"),
        ({"a": True}, {"a": 1}, "a: expected True, found 1"),
        ({"a": None}, {"a": 0.0}, "a: expected None, found 0.0"),
        ({"a": 3}, {"a": 3.0}, "a: expected 3, found 3.0"),
        ({"a": 1.0}, {"a": [1.0]}, "a: expected 1.0, found [1.0]"),
    ],
)
def test_differences_are_told_by_their_place(expected: Any, found: Any, said: str) -> None:
    assert differences("control", expected, found) == [said]


def test_numbers_differ_beyond_their_tolerance_only() -> None:
    for kind, tolerance in (("control", 1e-7), ("diagnosis", 1e-4)):
        for share, number in ((0.9, 0), (1.1, 1)):
            found = {"a": 5.0 * (1.0 + share * tolerance)}
            assert len(differences(kind, {"a": 5.0}, found)) == number


def test_a_change_is_told_and_renewed_on_request_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(GOLDEN / CONTROL_BAG, tmp_path / CONTROL_BAG)
    options = ["control", "--folder", str(tmp_path)]
    with pytest.raises(IdentError, match="expected a reference"):
        run(options)
    changed = _expected("control")
    changed["shipped"]["answers"][7]["voltage_v"][1] += 0.01
    reference = tmp_path / "control.json"
    reference.write_text(json.dumps(changed), encoding="utf-8")
    assert run(options) == 1
    assert "control: shipped.answers[7].voltage_v[1]: expected" in capsys.readouterr().out
    assert json.loads(reference.read_text(encoding="utf-8")) == changed
    assert run([*options, "--update"]) == 0
    assert differences("control", _expected("control"), json.loads(reference.read_text())) == []
    with pytest.raises(IdentError, match="expected control or diagnosis, found another"):
        run(["another", "--folder", str(tmp_path)])
    with pytest.raises(IdentError, match="beside --bags"):
        run([*options, "--bags"])
