"""Recordings in another unit of time or voltage are no model of the machine."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.identification import Identification, identify
from hydro_ident.identify.verdict import refused_numbers
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")


def slowed(recording: Recording, times: int) -> Recording:
    first = recording.stamp_ns[0]
    stamps = first + times * (recording.stamp_ns - first)
    return replace(recording, stamp_ns=stamps, period_s=times * recording.period_s)


def test_milliseconds_read_as_seconds_are_no_model(clean: Any) -> None:
    found = identify(load_robot("xs031"), [slowed(clean.recording(), 1000)])
    assert (found.verdict, found.robot) == ("not_enough_data", None)
    assert (
        "cycles: expected about 500 Hz, sensors.rate_hz of the robot file, found 0.5 Hz"
        in found.problems[0]
    )
    assert "milliseconds read as seconds" in found.problems[0]
    [forces] = [text for text in found.problems if text.startswith("forces rejected")]
    assert "all valves are off by a unit of time" in forces


def test_millivolts_of_volts_are_no_valve(clean: Any) -> None:
    recording = clean.recording()
    assert recording.valve_v is not None
    found = identify(load_robot("xs031"), [replace(recording, valve_v=1e-3 * recording.valve_v)])
    assert found.verdict == "partly_identified"
    rejected = [text for text in found.problems if text.startswith("hydraulics of")]
    assert len(rejected) == 2
    assert all("read too small (V read as mV)" in text for text in rejected)
    assert not any(text.startswith("forces rejected") for text in found.problems)
    assert found.robot is not None
    assert found.robot.valves == found.given.valves
    assert refused_numbers(found.robot) == []


def test_what_the_check_refuses_of_a_model_is_a_problem(found: Identification) -> None:
    assert found.robot is not None
    assert refused_numbers(found.robot) == []
    [text] = refused_numbers(replace(found.robot, atmospheric_pressure_pa=1.01325))
    assert text.startswith("the robot file's fluid: atmospheric_pressure_pa 1.01325 Pa")
    assert text.endswith("(`check_robot`)")
