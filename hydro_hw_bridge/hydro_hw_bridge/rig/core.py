"""The device without its bus: plant, instruments and amplifiers, one cycle at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.amplifier import Amplifier
from hydro_hw_bridge.rig.instruments import Instruments, Measurement
from hydro_hw_bridge.rig.payload import Payload
from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.pose import joints_for_tip, middle_pose
from hydro_hw_bridge.rig.truth import Truth
from hydro_model.robot import FloatArray, Robot

COUNTER_SPAN = 1 << 32


@dataclass(frozen=True, slots=True)
class Inputs:
    """The permissive inputs of the machine: all must be on for the amplifiers to drive."""

    emergency_stop_ok: bool = True
    pump_on: bool = True
    enable_switch: bool = True

    @property
    def all_on(self) -> bool:
        """Whether driving is permitted."""
        return self.emergency_stop_ok and self.pump_on and self.enable_switch


@dataclass(frozen=True, slots=True)
class Readings:
    """All that the device reports in one cycle.

    Attributes
    ----------
    counter : int
        Sample counter, 32 bits.
    measurement : Measurement
        The instruments.
    inputs : Inputs
    parked : bool
        Mechanically locked: no enabled valve frame yet.
    amplifier_enabled, amplifier_watchdog : bool
        Driving; switched off for want of frames.
    """

    counter: int
    measurement: Measurement
    inputs: Inputs
    parked: bool
    amplifier_enabled: bool
    amplifier_watchdog: bool


class RigCore:
    """The simulated machine, pure: the same arguments and calls give the same numbers.

    Parameters
    ----------
    robot : Robot
    truth : Truth
    seed : int
        Of the sensor noise.
    q : (n,) sequence, optional
        Initial joint positions, rad or m.
    tip_m : (3,) sequence, optional
        Initial tip position in the base frame, used where `q` is absent. By default the joints
        stand in the middle of their limits.
    inputs : Inputs
    first_counter : int
        Sample counter of the first cycle.
    payloads : sequence of Payload
        Loads at the tip, each in place of the one before from its instant on.

    Attributes
    ----------
    plant : Plant
        The truth.
    amplifier : Amplifier
    inputs : Inputs
        May be replaced at any time; takes effect in the next `actuate`.
    cycle_s : float
    counter : int
        Of the current cycle.
    cycles : int
        Cycles advanced so far.
    parked : bool

    Raises
    ------
    BridgeError
        The pose is out of reach, outside a stroke or too heavy for the supply.
    """

    def __init__(
        self,
        robot: Robot,
        truth: Truth,
        *,
        seed: int = 0,
        q: Sequence[float] | None = None,
        tip_m: Sequence[float] | None = None,
        inputs: Inputs | None = None,
        first_counter: int = 0,
        payloads: Sequence[Payload] = (),
    ) -> None:
        self.robot = robot
        self.truth = truth
        self.cycle_s = 1.0 / robot.sensors.rate_hz
        self.plant = Plant(robot, truth, _initial_pose(robot, q, tip_m))
        self._rated_v = np.array([v.rated_voltage_v for v in robot.valves])
        self.amplifier = Amplifier(self._rated_v, self.cycle_s, truth.command_delay_cycles)
        self.inputs = inputs if inputs is not None else Inputs()
        self.parked = True
        self.counter = first_counter % COUNTER_SPAN
        self.cycles = 0
        self._driven_cycles = 0
        self._payloads = sorted(payloads, key=lambda payload: payload.from_s)
        self._instruments = Instruments(self.plant, seed)
        names = [c.name for c in robot.cylinders]
        self._valve_cylinder = np.array([names.index(v.cylinder) for v in robot.valves], dtype=int)
        self._measurement = self._measure()

    def readings(self) -> Readings:
        """What the device reports in the current cycle; repeated calls give the same numbers."""
        return Readings(
            counter=self.counter,
            measurement=self._measurement,
            inputs=self.inputs,
            parked=self.parked,
            amplifier_enabled=self.amplifier.enabled,
            amplifier_watchdog=self.amplifier.tripped,
        )

    def actuate(self, voltages: Sequence[float] | None, enable: bool = True) -> None:
        """Advance exactly one cycle.

        Parameters
        ----------
        voltages : sequence of float or None
            V per valve of the robot, of the valid frame that arrived in this cycle; None where
            none did.
        enable : bool
            The frame's enable bit.

        Raises
        ------
        BridgeError
            Voltages that are not finite or not one per valve.
        """
        output = self.amplifier.step(voltages, enable, self.inputs.all_on)
        if self.amplifier.enabled:
            self.parked = False
        if not self.parked:
            self._take_payload()
            asked = np.zeros(len(self.robot.cylinders))
            asked[self._valve_cylinder] = output / self._rated_v
            self.plant.advance(np.clip(asked, -1.0, 1.0), self.cycle_s, pump=self.inputs.pump_on)
            self._driven_cycles += 1
        self.counter = (self.counter + 1) % COUNTER_SPAN
        self.cycles += 1
        self._measurement = self._measure()

    def _take_payload(self) -> None:
        """Change the load at the tip where its instant has come."""
        while self._payloads and self._driven_cycles >= round(
            self._payloads[0].from_s / self.cycle_s
        ):
            self.plant.load_tip(self._payloads.pop(0).mass_kg)

    def set_inputs(
        self,
        *,
        emergency_stop_ok: bool | None = None,
        pump_on: bool | None = None,
        enable_switch: bool | None = None,
    ) -> None:
        """Turn some of the permissive inputs on or off."""
        changes = {
            "emergency_stop_ok": emergency_stop_ok,
            "pump_on": pump_on,
            "enable_switch": enable_switch,
        }
        self.inputs = replace(self.inputs, **{k: v for k, v in changes.items() if v is not None})

    def drop_supply(self, pressure_pa: float) -> None:
        """Let the supply line lose its pressure, as where a hose bursts while the pump runs.

        The instruments show it in the cycle at hand; from then on the pump fills the line again.

        Parameters
        ----------
        pressure_pa : float
            Gauge, at most.
        """
        plant = self.plant
        plant.state[plant.lines_index] = min(plant.supply_pa, pressure_pa)
        self._measurement = self._measure()

    @property
    def truth_names(self) -> tuple[str, ...]:
        """Names of the columns of `truth_row`."""
        robot = self.robot
        return (
            "counter",
            "time_s",
            "parked",
            "enabled",
            *(f"position/{j}" for j in robot.joint_names),
            *(f"velocity/{j}" for j in robot.joint_names),
            *(f"stroke/{c.name}" for c in robot.cylinders),
            *(f"pressure/{c.name}/a" for c in robot.cylinders),
            *(f"pressure/{c.name}/b" for c in robot.cylinders),
            "pressure/supply",
            "pressure/tank",
            *(f"tip/{axis}" for axis in "xyz"),
            *(f"tip_velocity/{axis}" for axis in "xyz"),
            *(f"spool/{v}" for v in robot.valve_names),
            *(f"voltage/{v}" for v in robot.valve_names),
        )

    def truth_row(self) -> FloatArray:
        """The true state at the current sample, SI, pressures gauge, by `truth_names`.

        Time counts from the first cycle; the voltage is the amplifier's over the cycle that
        ends here.
        """
        plant = self.plant
        head = (self.counter, self.cycles * self.cycle_s, self.parked, self.amplifier.enabled)
        return np.concatenate(
            [
                head,
                plant.q,
                plant.qd,
                plant.strokes(),
                plant.pressures_a,
                plant.pressures_b,
                (plant.supply_pa, plant.tank_pa),
                plant.tip(),
                plant.spools[self._valve_cylinder],
                self.amplifier.output_v,
            ]
        )

    def _measure(self) -> Measurement:
        standing = self.parked and not self.inputs.pump_on
        return self._instruments.measure(depressurised=standing)


def _initial_pose(
    robot: Robot, q: Sequence[float] | None, tip_m: Sequence[float] | None
) -> FloatArray:
    if q is not None:
        return _checked_pose(robot, q)
    if tip_m is not None:
        return joints_for_tip(robot, np.asarray(tip_m, dtype=float))
    return middle_pose(robot)


def _checked_pose(robot: Robot, q: Sequence[float]) -> FloatArray:
    pose = np.asarray(q, dtype=float)
    if pose.shape != (robot.dof,):
        raise BridgeError(
            f"robot {robot.name}: expected {robot.dof} joint positions"
            f" ({', '.join(robot.joint_names)}), found {len(q)}"
        )
    for joint, value in zip(robot.joints, pose, strict=True):
        if not joint.lower <= value <= joint.upper:
            raise BridgeError(
                f"robot {robot.name}: expected '{joint.name}' within {joint.lower} to"
                f" {joint.upper}, found {value:g}"
            )
    return pose
