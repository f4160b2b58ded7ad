"""Stroke sensors and the oil's temperature drive nothing, whatever they say, and are named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import can
import pytest

from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.bridge_step import ReadingCounters
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Echo, Readings
from hydro_model.hydraulics.cylinder import stroke

NAMES = ("lift_valve", "tilt_valve")
LIMITS = GateLimits(NAMES, (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
NOW, PERIOD = 1_700_000_000_500_000_000, 2_000_000
#: Longer than an encoder or a pressure may be still.
CYCLES = 1200
Make = Callable[..., Readings]
#: What a broken sensor says in a cycle: of a stroke in m, of the oil in deg C.
BROKEN: dict[str, Callable[[int], float]] = {
    "stuck": lambda _: 0.21,
    "jumps": lambda k: 0.5 * (k % 2),
    "lowest": lambda _: -1e9,
    "highest": lambda _: 1e9,
}
#: How it is named; oil that stays as warm as it is, or half a degree off, is none to speak of.
NAMED = {
    "stuck": "lift_cylinder: stroke sensor stuck, not a count while lift moved the piston by 0.0",
    "jumps": "lift_cylinder: stroke jumped by 0.5000 m in 2 ms (at most 0.0",
    "lowest": "lift_cylinder: stroke cannot be -1.6384 m (from -0.0590 to 0.6490 m)",
    "highest": "lift_cylinder: stroke cannot be 1.6383 m (from -0.0590 to 0.6490 m)",
}


def _moving(k: int) -> dict[str, Any]:
    """What the other sensors say: all move, so that nothing is named of these."""
    noise = 500.0 * (k % 2)
    pressures = tuple(p + noise for p in (5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6))
    return {"positions": (0.3 + 1e-4 * k, -0.5 - 1e-4 * k), "pressures_pa": pressures}


def _driven(
    codec: Codec, readings: Make, stroke_m: Callable[[int], float], oil_c: Callable[[int], float]
) -> tuple[BridgeCore, list[bytes], list[Readings]]:
    """A drive: the core behind it, the valve frames and the samples."""
    sent: list[bytes] = []

    def send(message: can.Message) -> bool:
        sent.append(bytes(message.data))
        return True

    core, samples = BridgeCore(codec, LIMITS, lockstep=False, send=send), []
    core.activate(ready=True)
    for k in range(1, CYCLES):
        said = {"strokes_m": (stroke_m(k),), "oil_temperature_c": oil_c(k)}
        heard = Echo(len(sent), 0)
        for message in codec.encode_cycle(readings(k, echo=heard, **_moving(k), **said)):
            frame = codec.receive(message)
            assert frame is not None
            core.receive(frame, NOW)
        assert core.sample is not None
        samples.append(core.sample.readings)
        volts = 3.0 * (k % 20) / 20.0
        core.command(core.sample.stamp_ns, NAMES, (volts, -volts))
    return core, sent, samples


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_stroke_sensor_or_thermometer_changes_no_voltage_and_is_passed_on(
    sensed: Codec, readings: Make, kind: str
) -> None:
    cylinder = sensed.robot.cylinders[0]
    sound = [float(stroke(cylinder, _moving(k)["positions"][0])) for k in range(CYCLES)]
    whole, frames, _ = _driven(sensed, readings, sound.__getitem__, lambda _: 40.0)
    core, got, samples = _driven(sensed, readings, BROKEN[kind], BROKEN[kind])
    assert whole.gate.state is core.gate.state is GateState.DRIVING
    assert len(got) > CYCLES // 2
    assert got == frames
    assert set(asdict(whole.watch.counters).values()) == {0}
    assert whole.watch.newest == ""
    counted = core.watch.counters
    assert asdict(counted) == asdict(ReadingCounters()) | {
        "strokes": counted.strokes,
        "temperatures": counted.temperatures,
    }
    assert counted.strokes >= CYCLES // 3
    assert counted.temperatures == (CYCLES - 1) * (kind in ("lowest", "highest"))
    assert core.watch.newest.startswith(NAMED[kind])
    # Published as they come: whoever reads them is told nothing else.
    step, (lowest, highest) = 0.00005, (-32768 * 0.00005, 32767 * 0.00005)
    for k, sample in enumerate(samples, start=1):
        stroke_m = min(max(BROKEN[kind](k), lowest), highest)
        assert sample.strokes_m == (pytest.approx(stroke_m, abs=step),)
        assert sample.oil_temperature_c == pytest.approx(
            min(max(BROKEN[kind](k), -40.0), 215.9375), abs=0.0625
        )
