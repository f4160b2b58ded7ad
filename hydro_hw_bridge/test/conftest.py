"""What the bridge's tests share: the reference robot, its codec, readings to send, a bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import pytest
import yaml

from hydro_hw_bridge.bus.bus_health import BusCounters
from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.bridge_step import NOTHING, Step
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame, Echo, Readings, Status
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

GOOD = Status(emergency_stop_ok=True, pump_on=True, enable_switch=True, amplifier_enabled=True)
NAMES = ("lift_valve", "tilt_valve")
LIMITS = GateLimits(NAMES, (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
NOW = 1_700_000_000_500_000_000
PERIOD = 2_000_000
Make = Callable[..., Readings]


class Wire:
    """The end of a bus: takes frames or refuses them."""

    def __init__(self) -> None:
        self.taking = True
        self.off = False
        self.sent: list[can.Message] = []

    def send(self, message: can.Message) -> bool:
        if self.taking:
            self.sent.append(message)
        return self.taking

    @property
    def counters(self) -> BusCounters:
        """As of a bus."""
        return BusCounters(sent=len(self.sent))


class Bench:
    """A core, and the device and the controller at its ends."""

    def __init__(self, codec: Codec, readings: Make, *, lockstep: bool) -> None:
        self.wire = Wire()
        self.core = BridgeCore(
            codec, LIMITS, lockstep=lockstep, send=self.wire.send, hears_itself=True
        )
        self.codec, self.readings = codec, readings
        self.early: list[Step] = []

    def cycle(self, counter: int, **changes: Any) -> Step:
        """All frames of a cycle; the step of the last of them, those before it in `early`."""
        steps = []
        heard = Echo(len(self.wire.sent), 0)
        changes = {"lockstep": self.core.lockstep, "echo": heard} | changes
        for message in self.codec.encode_cycle(self.readings(counter, **changes)):
            frame = self.codec.receive(message)
            assert frame is not None
            steps.append(self.core.receive(frame, NOW))
        self.early = [step for step in steps[:-1] if step is not NOTHING]
        return steps[-1]

    def without(self, counter: int, lost: int, **changes: Any) -> list[Step]:
        """Steps of a cycle that lacks one of its frames."""
        changes = {"echo": Echo(len(self.wire.sent), 0)} | changes
        messages = self.codec.encode_cycle(self.readings(counter, **changes))
        frames = [self.codec.receive(m) for k, m in enumerate(messages) if k != lost]
        return [self.core.receive(frame, NOW) for frame in frames if frame is not None]

    def start(self) -> None:
        """An active core whose subscribers are there."""
        self.core.activate()
        self.core.ready = True

    def drive(self, lift: float = 1.0) -> None:
        """A core that drives: a cycle 1 that is answered."""
        self.core.activate(ready=True)
        self.cycle(1)
        assert self.command(1, lift).answer is not None
        assert self.core.gate.state is GateState.DRIVING

    def command(
        self, counter: int, lift: float, tilt: float = 0.0, unheard_s: float = 0.0
    ) -> Step:
        """The controller's voltages for a cycle."""
        zero = self.core.clock.zero_stamp_ns
        assert zero is not None
        stamp_ns = zero + counter * PERIOD
        return self.core.command(stamp_ns, NAMES, (lift, tilt), unheard_s=unheard_s)

    def sent(self, message: can.Message | None) -> CommandFrame:
        """What a valve frame says."""
        assert message is not None
        frame = self.codec.receive(message)
        assert frame is not None
        assert frame.intact
        return self.codec.decode_command(frame)


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot("xs031")


@pytest.fixture(scope="session")
def codec(robot: Robot) -> Codec:
    return Codec.load(None, None, robot)


@pytest.fixture
def coarse(codec: Codec, robot: Robot, tmp_path: Path) -> Codec:
    """One whose lift valve has counts of 50 mV, none of which is 0 V: the nearest is 20 mV."""
    content = yaml.safe_load(codec.mapping.source.read_text(encoding="utf-8"))
    content["valves"]["lift_valve"]["command"] |= {"scale": 100.0, "offset": 0.02}
    path = tmp_path / "coarse.mapping.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return Codec.load(codec.mapping.dbc, path, robot)


@pytest.fixture(scope="session")
def sensed(codec: Codec, robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Codec:
    """The reference crane with a stroke sensor, in the place of a spool's."""
    content = yaml.safe_load(codec.mapping.source.read_text(encoding="utf-8"))
    content["strokes"] = {"lift_cylinder": content["valves"]["lift_valve"].pop("spool")}
    path = tmp_path_factory.mktemp("can") / "sensed.mapping.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    cylinders = (replace(robot.cylinders[0], stroke_sensor=True), *robot.cylinders[1:])
    return Codec.load(codec.mapping.dbc, path, replace(robot, cylinders=cylinders))


@pytest.fixture(scope="session")
def readings() -> Make:
    """Readings of a cycle: `readings(counter, pump_on=False, spools=...)`."""

    def make(counter: int, **changes: Any) -> Readings:
        bits = {k: v for k, v in changes.items() if hasattr(GOOD, k)}
        values = {k: v for k, v in changes.items() if k not in bits}
        usual = Readings(
            counter=counter,
            status=replace(GOOD, **bits),
            positions=(0.3, -0.5),
            pressures_pa=(5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6),
            spools=(0.1, -0.2),
            oil_temperature_c=40.0,
        )
        return replace(usual, **values)

    return make


@pytest.fixture
def wire() -> Wire:
    """A bus's end that takes frames (`taking`), keeps them (`sent`) and may be `off`."""
    return Wire()


@pytest.fixture
def real_time(codec: Codec, readings: Make) -> Bench:
    """A core in real time between a device and a controller."""
    return Bench(codec, readings, lockstep=False)


@pytest.fixture
def lockstep(codec: Codec, readings: Make) -> Bench:
    """A core in lockstep between a device and a controller."""
    return Bench(codec, readings, lockstep=True)


@pytest.fixture(scope="module")
def trial(robot: Robot) -> Any:
    """Runs injections, machine and bridge core to core, with a publisher of large voltages."""
    # Here: most tests of the bridge need neither faults nor rig.
    from hydro_hw_bridge.faults.bench import WatchedCodec
    from hydro_hw_bridge.faults.trial import Trial
    from hydro_hw_bridge.faults.wave import Wave
    from hydro_hw_bridge.rig.core import RigCore
    from hydro_hw_bridge.rig.truth_files import load_truth

    codec = WatchedCodec.load(None, None, robot)
    truth = load_truth("realistic", robot)
    rated = tuple(valve.rated_voltage_v for valve in robot.valves)
    limits = GateLimits(robot.valve_names, rated, 0.002, 1000.0, 5, 2.0e6)

    def commander(seed: int) -> Wave:
        return Wave(
            robot.valve_names, rated, 2.0, frequency_hz=2.0 + seed % 4, period_s=limits.period_s
        )

    return Trial(codec, limits, lambda seed: RigCore(robot, truth, seed=seed), commander)
