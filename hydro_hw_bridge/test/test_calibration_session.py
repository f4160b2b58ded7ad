"""`Session` between a bus of this process and frames of a device that are written out here."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import pytest

from hydro_hw_bridge.bus import claims
from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.commissioning.calibration_session import MAX_REPEATS, Session
from hydro_hw_bridge.commissioning.calibration_steps import (
    MARGIN,
    REST_CYCLES,
    _check_within,
    unreferenced,
    valve_signs,
)
from hydro_hw_bridge.errors import CalibrationError
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame
from hydro_model.hydraulics.cylinder import lever
from hydro_model.robot import Robot

PATIENCE_S = 60.0


class Device:
    """Sends a cycle for every valve frame that it hears, with the counters that it is told."""

    def __init__(self, bus: Bus, codec: Codec, readings: Any, counters: list[int]) -> None:
        self.heard: list[CommandFrame] = []
        self._bus, self._codec, self._readings = bus, codec, readings
        self._counters = counters
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self._send(self._counters[0])
        for counter in self._counters[1:]:
            if not self._answered():
                return
            self._send(counter)
        while self._answered():
            pass

    def _send(self, counter: int) -> None:
        for message in self._codec.encode_cycle(self._readings(counter)):
            self._bus.send(message)

    def _answered(self) -> bool:
        while (message := self._bus.receive(2.0)) is not None:
            frame = self._codec.receive(message)
            if frame is not None and frame.role == "command":
                self.heard.append(self._codec.decode_command(frame))
                return True
        return False

    def join(self) -> None:
        self._thread.join(PATIENCE_S)


@pytest.fixture
def buses(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Bus, Bus]]:
    """Two ends of one bus of python-can inside this process, with no bridge to listen for."""
    monkeypatch.setattr(claims, "LISTEN_S", 0.02)
    monkeypatch.setattr(claims, "CONTEST_S", 0.02)
    name = f"virtual:calibration_{os.getpid()}"
    with open_bus(name) as one, open_bus(name) as other:
        yield one, other


def test_a_counter_that_stands_ends_what_is_driven(
    buses: tuple[Bus, Bus], codec: Codec, readings: Any
) -> None:
    """How long a valve is driven is counted in cycles of the device."""
    session = Session(buses[0], codec)
    device = Device(buses[1], codec, readings, [1, 2, *[3] * 200])
    cycles = session.cycles()
    next(cycles)
    session.drive("lift_valve", 0.5)
    assert next(cycles).counter == 2
    assert next(cycles).counter == 3
    with pytest.raises(CalibrationError, match="sample counter stands at 3 while it is driven"):
        next(cycles)
    session.stop()
    device.join()
    driven = [frame for frame in device.heard if frame.enable]
    assert 0 < len(driven) <= 2 + MAX_REPEATS + 1
    assert (device.heard[-1].voltages, device.heard[-1].enable) == ((0.0, 0.0), False)


def test_answers_that_are_lost_now_and_then_end_nothing(
    buses: tuple[Bus, Bus], codec: Codec, readings: Any
) -> None:
    """Nor does a machine that repeats its cycle for as long as nothing is driven."""
    session = Session(buses[0], codec)
    again = [counter for counter in range(2, 12) for _ in range(MAX_REPEATS)]
    Device(buses[1], codec, readings, [*[1] * 50, *again, 12])
    cycles = session.cycles()
    next(cycles)
    assert next(cycles).counter == 2
    session.drive("lift_valve", 0.5)
    assert [next(cycles).counter for _ in range(10)] == list(range(3, 13))
    session.stop()


@pytest.mark.parametrize(
    ("joint", "offset"), [("lift", 1.4), ("lift", -1.9), ("tilt", -1.5), ("tilt", 1.75)]
)
def test_no_valve_is_driven_with_an_encoder_that_reads_beyond_the_joints_limits(
    buses: tuple[Bus, Bus], codec: Codec, readings: Any, robot: Robot, joint: str, offset: float
) -> None:
    """So far off the lever has turned round, and with it the sign that would be found."""
    middle = [0.5 * (one.lower + one.upper) for one in robot.joints]
    k = robot.joint_index(joint)
    (cylinder,) = (one for one in robot.cylinders if one.joint == joint)
    assert lever(cylinder, middle[k]) * lever(cylinder, middle[k] + offset) < 0.0
    at_rest = partial(readings, positions=tuple(middle))
    session = Session(buses[0], codec)
    device = Device(buses[1], codec, at_rest, list(range(1, 3 * REST_CYCLES)))
    offsets = dict.fromkeys(codec.joint_names, 0.0) | {joint: offset}
    with pytest.raises(CalibrationError, match=f"joint {joint} reads .* [(]--reference {joint}="):
        valve_signs(session, robot, offsets, 0.05, lambda text: None)
    session.stop()
    device.join()
    assert not any(frame.enable for frame in device.heard)


class Creeping:
    """A session with a machine whose first piston creeps at 0 V; speeds in m/s."""

    def __init__(self, codec: Codec, robot: Robot, readings: Any) -> None:
        self.codec, self._robot, self._readings = codec, robot, readings
        self._q = [0.5 * (joint.lower + joint.upper) for joint in robot.joints]
        self._driven: str | None = None
        self._voltage_v = 0.0
        self.creep = 0.0
        self.per_volt = 0.03

    def drive(self, valve: str | None, voltage_v: float = 0.0) -> None:
        self._driven, self._voltage_v = valve, voltage_v

    def stop(self) -> None:
        self.drive(None)

    def cycles(self) -> Iterator[Any]:
        for counter in count():
            yield self._readings(counter, positions=tuple(self._q))
            for valve, cylinder in zip(self._robot.valves, self._robot.cylinders, strict=True):
                pushed = self._voltage_v if valve.name == self._driven else 0.0
                own = self.creep if cylinder is self._robot.cylinders[0] else 0.0
                speed = self.per_volt * pushed + own
                j = self._robot.joint_index(cylinder.joint)
                rate_hz = self._robot.sensors.rate_hz
                self._q[j] += speed / rate_hz / float(lever(cylinder, self._q[j]))


def signs_of(session: Creeping, robot: Robot, share: float = 0.05) -> tuple[dict[str, int], str]:
    said: list[str] = []
    offsets = dict.fromkeys(session.codec.joint_names, 0.0)
    found = valve_signs(session, robot, offsets, share, said.append)  # type: ignore[arg-type]
    return found, "\n".join(said)


def test_a_null_bias_changes_no_sign_and_the_force_is_told(
    codec: Codec, readings: Any, robot: Robot
) -> None:
    """A tenth of the pulse's speed is what 0.5 % of null bias makes beside 5 %."""
    session = Creeping(codec, robot, readings)
    session.creep = -0.0015
    for per_volt, sign in ((0.03, 1), (-0.03, -1)):
        session.per_volt = per_volt
        found, said = signs_of(session, robot)
        assert found == {"lift_valve": sign, "tilt_valve": sign}
        lift = robot.cylinders[0]
        # The readings' 50 and 20 bar.
        force_kn = 1e-3 * (5.0e6 * lift.area_a_m2 - 2.0e6 * lift.area_b_m2)
        assert f"lift_cylinder held {force_kn:+.1f} kN" in said


@pytest.mark.parametrize("creep", [-0.008, 0.008])
def test_a_load_that_creeps_decides_no_sign(
    codec: Codec, readings: Any, robot: Robot, creep: float
) -> None:
    """Faster than the pulse it goes the same way by either voltage."""
    session = Creeping(codec, robot, readings)
    session.creep, session.per_volt = creep, 0.01
    with pytest.raises(CalibrationError, match="lift_cylinder should be at rest at 0 V, found"):
        signs_of(session, robot)


def test_an_opposite_voltage_has_to_move_the_other_way(
    codec: Codec, readings: Any, robot: Robot
) -> None:
    session = Creeping(codec, robot, readings)
    for shares, text in (((1.0, 1.0), "one way by"), ((1.0, 0.0), "should move lift_cylinder by")):
        pulses = iter(shares)

        def drive(valve: str | None, voltage_v: float = 0.0, pulses: Any = pulses) -> None:
            """Whatever the voltage, the load goes out, or after the first pulse nowhere."""
            voltage_v = abs(voltage_v) * next(pulses) if valve else 0.0
            Creeping.drive(session, valve, voltage_v)

        session.drive = drive  # type: ignore[method-assign]
        with pytest.raises(CalibrationError, match=text):
            signs_of(session, robot)


def test_a_joint_against_its_stop_may_read_a_little_beyond_its_limit(robot: Robot) -> None:
    (first, *_), middle = robot.joints, {j.name: 0.5 * (j.lower + j.upper) for j in robot.joints}
    beyond = MARGIN * (first.upper - first.lower)
    for end, out in ((first.lower, -1.0), (first.upper, 1.0)):
        _check_within(robot, middle | {first.name: end + 0.99 * out * beyond})
        with pytest.raises(CalibrationError, match=f"joint {first.name} reads"):
            _check_within(robot, middle | {first.name: end + 1.01 * out * beyond})


def test_a_joint_that_slides_with_its_cylinder_needs_no_reference(robot: Robot) -> None:
    lift, tilt = robot.cylinders
    sliding = replace(robot, cylinders=(replace(lift, l1_m=0.0), tilt))
    assert unreferenced(robot, ()) == ["lift", "tilt"]
    assert unreferenced(robot, {"lift"}) == ["tilt"]
    assert unreferenced(sliding, ()) == ["tilt"]
