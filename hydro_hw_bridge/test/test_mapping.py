"""Mapping, DBC and calibration files: one line on everything that does not fit."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.node.bridge_start import calibration_remarks
from hydro_hw_bridge.protocol.calibration import (
    Calibration,
    calibrated_mapping,
    calibration_text,
    channels_hash,
    load_calibration,
    unmeasured,
)
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings
from hydro_model.robot import Robot
from hydro_msgs_docs.errors import ContractError
from hydro_msgs_docs.shipped_mapping import default_mapping

Edit = Callable[[dict[str, Any]], object]
Make = Callable[..., Readings]

BAD: list[tuple[str, Edit, str]] = [
    ("schema", lambda m: m.update(schema="other/1"), "expected schema hydro_hw_bridge/mapping/1"),
    ("unknown key", lambda m: m.update(speed=3), "unknown key 'speed'"),
    ("no name", lambda m: m.pop("name"), "key 'name' is missing"),
    ("joint unknown", lambda m: m["joints"].update(slew={"signal": "x"}), "has no 'slew'"),
    ("joint missing", lambda m: m["joints"].pop("tilt"), "'tilt' of the robot is missing"),
    (
        "pressure unknown",
        lambda m: m["pressures"].update({"lift_cylinder/c": {}}),
        "has no 'lift_cylinder/c'",
    ),
    ("pressure missing", lambda m: m["pressures"].pop("tilt_cylinder/b"), "tilt_cylinder/b"),
    ("valve unknown", lambda m: m["valves"].update(grab={}), "has no 'grab'"),
    ("valve missing", lambda m: m["valves"].pop("lift_valve"), "'lift_valve' of the robot"),
    (
        "signal unknown",
        lambda m: m["joints"]["lift"].update(signal="ENCODERS.Lift"),
        "no signal 'ENCODERS.Lift' in xs031.dbc",
    ),
    (
        "signal twice",
        lambda m: m["joints"]["lift"].update(signal="ENCODERS.TiltEncoder"),
        "signal 'ENCODERS.TiltEncoder' is used more than once",
    ),
    (
        "signal in the wrong frame",
        lambda m: m["joints"]["lift"].update(signal="VALVE_COMMAND.CommandCrc"),
        "should be in a frame of role sync or cycle",
    ),
    (
        "signal under the protection",
        lambda m: m["joints"]["lift"].update(signal="ENCODERS.EncodersCrc"),
        "overlaps the protection",
    ),
    (
        "counter too short",
        lambda m: m["sync"].update(counter="SYNC.SyncAlive"),
        "should have 32 bits",
    ),
    ("sign", lambda m: m["joints"]["lift"].update(sign=2), "'sign' should be 1 or -1"),
    ("scale", lambda m: m["joints"]["lift"].update(scale=0), "'scale' should be a number above 0"),
    (
        "reference",
        lambda m: m["pressures"]["supply"].update(reference="vacuum"),
        "gauge or absolute",
    ),
    (
        "no reference",
        lambda m: m["pressures"]["supply"].pop("reference"),
        "'reference' is missing",
    ),
    ("role", lambda m: m["frames"]["SYNC"].update(role="boss"), "should be one of sync, cycle"),
    ("no sync", lambda m: m["frames"]["SYNC"].update(role="cycle"), "one frame of role sync"),
    (
        "two claims",
        lambda m: m["frames"]["ENCODERS"].update(role="claim"),
        "expected one frame of role claim",
    ),
    (
        "identifiers",
        lambda m: m["frames"]["SYNC"].update(e2e_profile_2=[1, 2, 3]),
        "'e2e_profile_2' should be 16 numbers",
    ),
    (
        "identifier range",
        lambda m: m["frames"]["SYNC"]["e2e_profile_2"].__setitem__(3, 256),
        "integers from 0 to 255, found 256",
    ),
    (
        "protection",
        lambda m: m["frames"]["SYNC"].update(protection="hope"),
        "found 'protection: hope'",
    ),
    (
        "frame unknown",
        lambda m: m["frames"].update(EXTRA={"role": "cycle", "protection": "none"}),
        "no frame 'EXTRA'",
    ),
    (
        "no permissive",
        lambda m: m["sync"]["status"].pop("pump_on"),
        "key 'pump_on' is missing",
    ),
    ("half an echo", lambda m: m["sync"]["echo"].pop("refused"), "key 'refused' is missing"),
    ("echo of what", lambda m: m["sync"]["echo"].update(seen="SYNC.PumpOn"), "unknown key 'seen'"),
    ("key of sync", lambda m: m["sync"].update(count="SYNC.PumpOn"), "unknown key 'count'"),
    (
        "echo of a command",
        lambda m: m["sync"]["echo"].update(taken="VALVE_COMMAND.Enable"),
        "is used more than once",
    ),
    (
        "voltage does not fit",
        lambda m: m["valves"]["lift_valve"]["command"].update(scale=0.5),
        "10 V of valve 'lift_valve' does not fit",
    ),
    ("load", lambda m: m.update(bitrate=500000), "expected at most 50 % bus load"),
]


def test_amplifiers_that_do_not_tell_what_they_heard_are_allowed(
    codec: Codec, robot: Robot, tmp_path: Path, readings: Make
) -> None:
    path = edited(codec, tmp_path, lambda m: m["sync"].pop("echo"))
    silent = Codec.load(codec.mapping.dbc, path, robot)
    assert silent.echo_spans == ()
    frames = [silent.receive(m) for m in silent.encode_cycle(readings(7))]
    assert silent.readings({f.name: f.data for f in frames if f is not None}).echo is None


def edited(codec: Codec, folder: Path, edit: Edit) -> Path:
    content = yaml.safe_load(codec.mapping.source.read_text(encoding="utf-8"))
    edit(content)
    path = folder / "bad.mapping.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(("edit", "text"), [b[1:] for b in BAD], ids=[b[0] for b in BAD])
def test_bad_mapping_is_one_clear_line(
    codec: Codec, robot: Robot, tmp_path: Path, edit: Edit, text: str
) -> None:
    path = edited(codec, tmp_path, edit)
    with pytest.raises(BridgeError) as raised:
        Codec.load(codec.mapping.dbc, path, robot)
    assert text in str(raised.value)
    assert "\n" not in str(raised.value)
    assert raised.value.exit_code == 2


def test_unprotected_frames_and_unmeasured_supply_are_allowed(
    codec: Codec, robot: Robot, tmp_path: Path, readings: Callable[..., Any]
) -> None:
    def edit(mapping: dict[str, Any]) -> None:
        for frame in mapping["frames"].values():
            frame.pop("e2e_profile_2")
            frame["protection"] = "none"
        mapping["pressures"].pop("supply")
        mapping.pop("oil_temperature")
        mapping["valves"]["tilt_valve"].pop("spool")

    plain = Codec.load(codec.mapping.dbc, edited(codec, tmp_path, edit), robot)
    assert "supply" not in plain.pressure_names
    values = readings(70000, pressures_pa=(1e6, 2e6, 3e6, 4e6, 1e6), oil_temperature_c=None)
    frames = [plain.receive(message) for message in plain.encode_cycle(values)]
    assert [frame.alive for frame in frames if frame] == [None] * 5
    got = plain.readings({frame.name: frame.data for frame in frames if frame})
    assert got.pressures_pa == values.pressures_pa
    assert got.oil_temperature_c is None
    assert math.isnan(got.spools[1])
    command = plain.receive(plain.encode_command(70000, (1.0, 2.0), False))
    assert command is not None
    assert plain.decode_command(command).answers(70000)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no DBC file"),
        ("this is no dbc", "not a valid DBC"),
        ('VERSION ""\nBU_: A\n', "no frame 'SYNC' (known: none)"),
    ],
)
def test_bad_dbc_is_one_clear_line(
    codec: Codec, robot: Robot, tmp_path: Path, text: str | None, message: str
) -> None:
    path = tmp_path / "bad.dbc"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(BridgeError) as raised:
        Codec.load(path, codec.mapping.source, robot)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("signal", "found"),
    [
        ("EmergencyStopOk : {at}|1@1+ (-1,1)", "1 unsigned bits of factor -1 and offset 1"),
        ("EmergencyStopOk : {at}|1@1- (1,0)", "1 signed bits of factor 1 and offset 0"),
        ("Enable : {at}|2@1+ (1,0)", "2 unsigned bits of factor 1 and offset 0"),
        ("Enable : {at}|1@1+ (-1,1)", "1 unsigned bits of factor -1 and offset 1"),
        ("SampleCounter : {at}|32@1+ (2,0)", "32 unsigned bits of factor 2 and offset 0"),
        ("Instance : {at}|16@1+ (1,0)", "should have 32 bits, found 16"),
        ("Instance : {at}|32@1+ (1,-1)", "32 unsigned bits of factor 1 and offset -1"),
    ],
)
def test_states_and_counts_that_a_dbc_would_turn_round_are_refused(
    codec: Codec, robot: Robot, tmp_path: Path, signal: str, found: str
) -> None:
    name = signal.split(" ")[0]
    text = codec.mapping.dbc.read_text(encoding="utf-8")
    line = re.search(rf"{name} : (\d+)\|\d+@\d[+-] \([^)]*\)", text)
    assert line
    path = tmp_path / "other.dbc"
    path.write_text(text.replace(line[0], signal.format(at=line[1])), encoding="utf-8")
    with pytest.raises(BridgeError) as raised:
        Codec.load(path, codec.mapping.source, robot)
    assert f".{name}'" in str(raised.value)
    assert found in str(raised.value)


@pytest.mark.parametrize("text", ["", "[1, 2]", "a: [", "\x00"])
def test_garbage_mapping(robot: Robot, tmp_path: Path, text: str) -> None:
    path = tmp_path / "garbage.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BridgeError) as raised:
        Codec.load(None, path, robot)
    assert str(path) in str(raised.value)


def test_a_robot_without_a_shipped_mapping() -> None:
    with pytest.raises(ContractError, match="no mapping is shipped for robot 'unknown'"):
        default_mapping("unknown")


def calibration() -> Calibration:
    return Calibration("c", "xs031", "xs031", {"supply": 1e3}, {"lift": 0.1}, {"lift_valve": -1})


def test_calibration_file_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(calibration_text(calibration(), {"date": "today"}), encoding="utf-8")
    assert load_calibration(path) == calibration()
    hashed = replace(calibration(), channels="0123456789012345")  # all digits, and still a text
    path.write_text(calibration_text(hashed, {}), encoding="utf-8")
    assert load_calibration(path) == hashed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "x"}, "expected schema hydro_hw_bridge/calibration/1"),
        ({"valve_sign": {"lift_valve": 0.5}}, "should be 1 or -1, found 0.5"),
        ({"pressure_zero_pa": [1]}, "should be a mapping of names to numbers"),
    ],
)
def test_bad_calibration_file(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    content = yaml.safe_load(calibration_text(calibration(), {})) | change
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(BridgeError, match=message):
        load_calibration(path)
    with pytest.raises(BridgeError, match="no calibration file"):
        load_calibration(tmp_path / "absent.yaml")


def test_a_calibration_of_another_machine_is_refused(codec: Codec) -> None:
    other = Calibration("c", "xs031", "other", {}, {}, {})
    with pytest.raises(BridgeError, match="expected one of mapping 'xs031', found mapping"):
        calibrated_mapping(codec.mapping, other, "xs031")
    strange = Calibration("c", "xs031", "xs031", {}, {"wrist": 0.1}, {})
    with pytest.raises(BridgeError, match="no joint 'wrist'"):
        calibrated_mapping(codec.mapping, strange, "xs031")
    with pytest.raises(BridgeError, match="one of robot 'crane_B', found robot 'xs031'"):
        calibrated_mapping(codec.mapping, calibration(), "crane_B")


def test_a_calibration_of_a_mapping_that_was_changed_since_is_refused(codec: Codec) -> None:
    """A sign that was mended in the mapping would be turned twice."""
    mapping = codec.mapping
    measured = replace(calibration(), channels=channels_hash(mapping))
    calibrated_mapping(mapping, measured, "xs031")
    lift = mapping.valves["lift_valve"]
    mended = replace(lift, command=replace(lift.command, sign=-1))
    changed = replace(mapping, valves={**mapping.valves, "lift_valve": mended})
    with pytest.raises(BridgeError, match="offsets or signs have been changed since"):
        calibrated_mapping(changed, measured, "xs031")
    (remark, _) = calibration_remarks(mapping, calibration())
    assert remark.startswith("calibration c does not say with which channels of ")


def test_a_calibration_without_a_reference_or_sign_is_not_driven_with(codec: Codec) -> None:
    said = unmeasured(codec.mapping, calibration())
    assert "found no position_offset of tilt (--reference tilt=VALUE)" in said
    assert "and no valve_sign of tilt_valve (--signs)" in said
    zeros = Calibration("c", "xs031", "xs031", {"supply": 1e3}, {}, {})
    assert "of lift, tilt (--reference lift=VALUE tilt=VALUE)" in unmeasured(codec.mapping, zeros)
    assert calibration_remarks(codec.mapping, zeros)[-1].startswith("not driven with calibration")
    signs = {"lift_valve": 1, "tilt_valve": 1}
    whole = replace(zeros, position_offset={"lift": 0.0, "tilt": 0.0}, valve_sign=signs)
    assert unmeasured(codec.mapping, whole) == ""
    assert calibration_remarks(codec.mapping, None) == []
