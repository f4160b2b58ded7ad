"""Sensors that come slower, in turns, or with gaps: taken at their rate, or told as such."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.identify import run
from hydro_msgs_docs.cdr import JOINT_STATE

pytestmark = pytest.mark.needs("clarabel", "plotly")

START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000


#: Topic, entry by entry of a message: in which cycles it is there.
There = dict[str, dict[str, np.ndarray]]


@pytest.fixture
def identified(tmp_path: Path) -> Callable[..., dict]:
    """The result of a bag of some columns, entries in some cycles only."""

    def of(columns: dict, there: There, stamps: np.ndarray | None = None) -> dict:
        out, bag = tmp_path / "out", tmp_path / "bag"
        with BagWriter(bag) as writer:
            for topic, (names, fields) in columns.items():
                writer.add_topic(topic, JOINT_STATE)
                for k in range(len(next(iter(fields.values())))):
                    gone = [n in there.get(topic, {}) and not there[topic][n][k] for n in names]
                    if all(gone):
                        continue
                    stamp = START_NS + PERIOD_NS * k if stamps is None else int(stamps[k])
                    at = [i for i, one in enumerate(gone) if not one]
                    entries = {f: v[k, at].tolist() for f, v in fields.items()}
                    writer.write_stamped(topic, stamp, entries, names=[names[i] for i in at])
        run([str(bag), "--robot", "xs031", "--out", str(out)])
        result: dict = json.loads((out / "result.json").read_text())
        return result

    return of


def test_pressures_with_every_fifth_stamp_are_taken_at_their_rate(crane_run, identified) -> None:
    read = np.arange(len(crane_run.q)) % 5 == 0
    there = {"/chamber_pressures": dict.fromkeys(crane_run.robot.pressure_names, read)}
    result = identified(crane_run.columns(), there)
    [recording] = result["recordings"]
    assert recording["rate_hz"] == pytest.approx(100.0)
    assert recording["gaps"] == 0
    values = {p["name"]: p["value"] for p in result["parameters"] if p["identifiable"]}
    assert values["tilt_cylinder.viscous_friction"] == pytest.approx(4.1e4, rel=0.05)


def test_joints_in_messages_of_their_own_are_named(crane_run, identified) -> None:
    """Each joint has every other stamp; torques stand in for pressures of both."""
    columns = crane_run.columns()
    del columns["/chamber_pressures"]
    columns["/joint_states"][1]["effort"] = 1e3 * crane_run.q
    even = np.arange(len(crane_run.q)) % 2 == 0
    there = {"/joint_states": {"lift": even, "tilt": ~even}}
    [text, *_] = identified(columns, there)["problems"]
    assert "too short" not in text
    assert "lift position in 50%, tilt position in 50%" in text
    assert "with one stamp for a cycle" in text


def test_cylinders_in_turns_are_named(crane_run, identified) -> None:
    even = np.arange(len(crane_run.q)) % 2 == 0
    turns = {"lift_cylinder": even, "tilt_cylinder": ~even}
    there = {f"{name}/{side}": turn for name, turn in turns.items() for side in "ab"}
    [text, *_] = identified(crane_run.columns(), {"/chamber_pressures": there})["problems"]
    assert "too short" not in text
    assert "lift_cylinder/a in 50%" in text
    assert "tilt_cylinder/b in 50%" in text


def test_a_gap_every_second_is_told(crane_run, identified) -> None:
    stamps = START_NS + PERIOD_NS * np.arange(len(crane_run.q))
    stamps += 10 * PERIOD_NS * (np.arange(len(stamps)) // 500)
    [text, *_] = identified(crane_run.columns(), {}, stamps)["problems"]
    assert "the longest of 18 stretches without a gap lasts 0.998 s of 18.4 s" in text
    assert "excite" not in text
