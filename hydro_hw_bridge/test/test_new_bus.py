"""A bus made for a robot carries all that its file names, and is refused where it cannot."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from hydro_hw_bridge.commissioning.bus_files import bus_files
from hydro_hw_bridge.commissioning.new_bus import main
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Echo, Readings, Status
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

CRANE = load_robot("xs031")


def longer(times: int, rate_hz: float = 500.0) -> Robot:
    """The reference crane's joints, cylinders and valves so many times behind each other."""
    joints, cylinders, valves = [], [], []
    for k in range(times):
        joints += [replace(j, name=f"{j.name}{k}") for j in CRANE.joints]
        cylinders += [
            replace(c, name=f"{c.name}{k}", joint=f"{c.joint}{k}") for c in CRANE.cylinders
        ]
        valves += [
            replace(v, name=f"{v.name}{k}", cylinder=f"{v.cylinder}{k}") for v in CRANE.valves
        ]
    return replace(
        CRANE,
        name=f"crane{times}",
        joints=tuple(joints),
        cylinders=tuple(cylinders),
        valves=tuple(valves),
        link_inertia=np.tile(CRANE.link_inertia, (times, 1)),
        sensors=replace(CRANE.sensors, rate_hz=rate_hz),
    )


def shorter(robot: Robot, joints: int) -> Robot:
    """Its first joints alone."""
    return replace(
        robot,
        joints=robot.joints[:joints],
        cylinders=robot.cylinders[:joints],
        valves=robot.valves[:joints],
        link_inertia=robot.link_inertia[:joints],
    )


def strange() -> Robot:
    """Names that no DBC takes, alike in all that is left of them; a slide; a stroke sensor."""
    lift, tilt = (replace(j, name=f"Größe.{'x' * 40}/{k}") for k, j in enumerate(CRANE.joints))
    slide = replace(tilt, prismatic=True, lower=0.2, upper=1.9)
    cylinders = tuple(
        replace(c, joint=j.name, stroke_sensor=True)
        for c, j in zip(CRANE.cylinders, (lift, slide), strict=True)
    )
    return replace(CRANE, name="strange", joints=(lift, slide), cylinders=cylinders)


ROBOTS = {
    "xs031": CRANE,
    "patu655": load_robot("patu655"),
    "three joints": shorter(longer(2), 3),
    "four joints": longer(2),
    "six joints": longer(3),
    "slow": longer(2, 100.0),
    "strange": strange(),
}


def made(robot: Robot, folder: Path) -> Codec:
    files = bus_files(robot, "made.dbc")
    (folder / "made.dbc").write_text(files.dbc, encoding="utf-8")
    (folder / "made.mapping.yaml").write_text(files.mapping, encoding="utf-8")
    return Codec.load(None, folder / "made.mapping.yaml", robot)


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return ROBOTS[request.param]


def test_all_that_is_measured_comes_back_to_half_a_step(robot: Robot, tmp_path: Path) -> None:
    codec, random = made(robot, tmp_path), np.random.default_rng(4)
    assert codec.joint_names == robot.joint_names
    assert codec.pressure_names == robot.pressure_names
    assert codec.stroke_names == tuple(c.name for c in robot.cylinders if c.stroke_sensor)
    strokes = [c.stroke_m for c in robot.cylinders if c.stroke_sensor]
    low, high = np.array([(j.lower, j.upper) for j in robot.joints]).T
    step = [
        (1.0 if j.prismatic else 2.0 * math.pi) / robot.sensors.encoder_counts_per_rev
        for j in robot.joints
    ]
    for counter in (0, 7, 2**32 - 1):
        # Of a machine that ran away, too: half of its range beyond its ends.
        q = low + (high - low) * random.uniform(-0.49, 1.49, robot.dof)
        p = random.uniform(-0.09, 1.09, len(robot.pressure_names))
        pressures = p * robot.sensors.pressure_range_pa
        spools = random.uniform(-1.0, 1.0, len(robot.valves))
        x = np.array(strokes) * random.uniform(-0.49, 1.49, len(strokes))
        status = Status(*(bool(bit) for bit in random.integers(0, 2, 7)))
        values = tuple(tuple(part.tolist()) for part in (q, pressures, spools, x))
        sent = Readings(counter, status, *values, 41.3, Echo(counter % 256, counter % 32))
        frames = [codec.receive(message) for message in codec.encode_cycle(sent)]
        assert all(frame is not None and frame.intact for frame in frames)
        got = codec.readings({frame.name: frame.data for frame in frames if frame is not None})
        assert (got.counter, got.status, got.echo) == (counter, status, sent.echo)
        assert np.all(np.abs(np.array(got.positions) - q) <= 0.5001 * np.array(step))
        assert np.abs(np.array(got.pressures_pa) - pressures).max() <= 500.0
        assert np.all(np.abs(np.array(got.strokes_m) - x) <= 0.51e-6)
        if not np.isnan(got.spools).any():
            assert np.abs(np.array(got.spools) - spools).max() <= 2.6e-5


def test_every_valve_is_told_its_voltage_and_0_v_exactly(robot: Robot, tmp_path: Path) -> None:
    codec = made(robot, tmp_path)
    rated = np.array([valve.rated_voltage_v for valve in robot.valves])
    assert codec.valve_names == robot.valve_names
    for share in (-1.0, -0.37, 0.0, 0.5, 1.0):
        asked = share * rated * np.where(np.arange(len(rated)) % 2, -1.0, 1.0)
        frame = codec.receive(codec.encode_command(70_000, tuple(asked.tolist()), True))
        assert frame is not None
        assert frame.intact
        command = codec.decode_command(frame)
        assert command.enable
        assert command.answers(70_000)
        assert not command.answers(70_001)
        off = np.abs(np.array(command.voltages) - asked) / rated
        assert off.max() <= (0.0 if share == 0.0 else 0.005)


def test_a_frame_under_the_identifier_of_another_is_none(robot: Robot, tmp_path: Path) -> None:
    codec = made(robot, tmp_path)
    zeros = [(0.0,) * len(n) for n in (codec.joint_names, codec.pressure_names)]
    still = Readings(
        5, Status(), *zeros, (0.0,) * len(robot.valves), (0.0,) * len(codec.stroke_names), 20.0,
        Echo(0, 0),
    )  # fmt: skip
    sent = codec.encode_cycle(still)
    for one in sent:
        for other in {m.arbitration_id for m in sent} - {one.arbitration_id}:
            moved = can.Message(arbitration_id=other, data=one.data, is_extended_id=False)
            frame = codec.receive(moved)
            assert frame is not None
            assert not frame.intact


@pytest.mark.parametrize(
    ("name", "wire", "spools"),
    [
        ("xs031", True, True),
        ("three joints", True, False),  # with its spools it would load a wire by more than half
        ("four joints", False, True),
        ("slow", True, True),
        ("six joints", False, True),
        ("patu655", False, True),  # at 1000 Hz
    ],
)
def test_spools_go_first_where_a_wire_does_not_carry_all(
    name: str, wire: bool, spools: bool, tmp_path: Path
) -> None:
    codec = made(ROBOTS[name], tmp_path)
    assert bus_files(ROBOTS[name], "made.dbc").fits_a_wire == wire
    assert (codec.layout.bitrate == 1_000_000) == wire
    assert codec.layout.bus_load <= 0.5
    assert (codec.mapping.oil_temperature is not None) == spools
    assert all((v.spool is not None) == spools for v in codec.mapping.valves.values())


def test_a_robot_without_valve_and_one_of_too_many_are_refused() -> None:
    with pytest.raises(BridgeError, match="expected a valve to be driven, found none"):
        bus_files(replace(CRANE, valves=()), "made.dbc")
    with pytest.raises(BridgeError, match="at most 6 valves, whose voltages are in one frame, fo"):
        bus_files(longer(4), "made.dbc")


def test_the_command_writes_both_files_and_none_over_one_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, told = tmp_path / "bus", tmp_path / "told.json"
    words = ["--robot", "xs031", "--out", str(out), "--json", str(told)]
    assert main(words) == 0
    files = [str(out / name) for name in ("xs031.dbc", "xs031.mapping.yaml")]
    assert json.loads(told.read_text("utf-8")) == {
        "schema": "hydro_hw_bridge/new_bus/1",
        "files": files,
    }
    assert capsys.readouterr().out.split() == files
    Codec.load(None, files[1], CRANE)
    (out / "xs031.dbc").write_text("edited", encoding="utf-8")
    assert main(words) == 2
    assert "xs031.dbc is there already: --force writes it anew" in capsys.readouterr().err
    assert (out / "xs031.dbc").read_text("utf-8") == "edited"
    assert main([*words, "--force"]) == 0
    Codec.load(None, files[1], CRANE)


def test_what_no_wire_carries_is_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["--robot", "patu655", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().err
    assert "warning: no CAN wire carries that" in said
    assert "of 2000000 bit/s" in said
