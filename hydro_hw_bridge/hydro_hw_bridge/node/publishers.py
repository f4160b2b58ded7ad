"""Samples and valve states as messages."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import FluidPressure, JointState, Temperature

from hydro_hw_bridge.protocol.bridge_step import Sample, ValveState
from hydro_hw_bridge.protocol.codec import Codec
from hydro_msgs_docs.cdr import JOINT_STATE
from hydro_msgs_docs.hot_messages import HotMessage
from hydro_msgs_docs.messages import set_stamp
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    JOINT_STATES,
    OIL_TEMPERATURE,
    VALVE_STATE,
    reliable,
)

#: Weight of the newest difference in the displayed joint velocity: 10 ms time constant at 500 Hz.
VELOCITY_WEIGHT = 0.2


class VelocityDisplay:
    """Joint velocity for displays: smoothed differences, 0 where the samples have a gap.

    Parameters
    ----------
    size : int
    period_s : float
    """

    def __init__(self, size: int, period_s: float) -> None:
        self._period_s = period_s
        self._velocity = [0.0] * size
        self._position: tuple[float, ...] = ()
        self._counter = 0

    def update(self, counter: int, position: tuple[float, ...]) -> list[float]:
        """The velocity at a sample, in units of `position` per second."""
        if counter == self._counter + 1 and len(position) == len(self._position):
            for i, (new, old) in enumerate(zip(position, self._position, strict=True)):
                difference = (new - old) / self._period_s
                self._velocity[i] += VELOCITY_WEIGHT * (difference - self._velocity[i])
        elif counter != self._counter:
            self._velocity = [0.0] * len(position)
        self._counter, self._position = counter, position
        return self._velocity


class BridgePublishers:
    """The bridge's publishers and what is the same in all their messages.

    Parameters
    ----------
    node : Node
    codec : Codec
    period_s : float
    slow_rate_hz : float
        Of the readings for generic tools.
    """

    def __init__(self, node: Node, codec: Codec, period_s: float, slow_rate_hz: float) -> None:
        self._node = node
        self._atmosphere_pa = codec.robot.atmospheric_pressure_pa
        self._slow_cycles = max(1, round(1.0 / (slow_rate_hz * period_s)))
        names = [*codec.joint_names, *codec.stroke_names]
        self._has_spools = any(v.spool is not None for v in codec.mapping.valves.values())
        valves = ("effort", "position") if self._has_spools else ("effort",)
        self._joints = self._vector(JOINT_STATES, names, ("position", "velocity"))
        self._pressures = self._vector(CHAMBER_PRESSURES, codec.pressure_names, ("effort",))
        self._valves = self._vector(VALVE_STATE, codec.valve_names, valves)
        self._slow = [
            (i, self._publisher(FluidPressure, f"/pressure/{name}"))
            for i, name in enumerate(codec.pressure_names)
            if "/" in name
        ]
        self._temperature = (
            None
            if codec.mapping.oil_temperature is None
            else self._publisher(Temperature, OIL_TEMPERATURE)
        )
        self._velocity = VelocityDisplay(len(names), period_s)
        # Both threads of the bridge state what the valves got; they share the one message.
        self._stating = threading.Lock()

    def _publisher(self, kind: Any, topic: str) -> Any:
        return self._node.create_publisher(
            kind,
            topic,
            reliable(),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def _vector(
        self, topic: str, names: Sequence[str], fields: Sequence[str]
    ) -> tuple[Any, HotMessage]:
        message = HotMessage(JOINT_STATE, dict.fromkeys(fields, len(names)), names=names)
        return self._publisher(JointState, topic), message

    def matched(self, required: Mapping[str, int]) -> list[str]:
        """The topics that have fewer subscribers than required, as `topic (found of required)`."""
        vectors = {
            JOINT_STATES: self._joints,
            CHAMBER_PRESSURES: self._pressures,
            VALVE_STATE: self._valves,
        }
        missing = []
        for topic, count in required.items():
            found = vectors[topic][0].get_subscription_count()
            if found < count:
                missing.append(f"{topic} ({found} of {count})")
        return missing

    def publish_sample(self, sample: Sample) -> None:
        """Publish a cycle under its one stamp; pressures become absolute here."""
        readings = sample.readings
        position = (*readings.positions, *readings.strokes_m)
        velocity = self._velocity.update(sample.counter, position)
        publisher, message = self._joints
        publisher.publish(message.filled(sample.stamp_ns, position, velocity))
        absolute = [p + self._atmosphere_pa for p in readings.pressures_pa]
        publisher, message = self._pressures
        publisher.publish(message.filled(sample.stamp_ns, absolute))
        if sample.counter % self._slow_cycles == 0 and not sample.repeated:
            self._publish_slow(sample, absolute)

    def _publish_slow(self, sample: Sample, absolute_pa: Sequence[float]) -> None:
        for index, publisher in self._slow:
            message = FluidPressure(fluid_pressure=absolute_pa[index])
            set_stamp(message, sample.stamp_ns)
            publisher.publish(message)
        if self._temperature is not None and sample.readings.oil_temperature_c is not None:
            reading = Temperature(temperature=sample.readings.oil_temperature_c)
            set_stamp(reading, sample.stamp_ns)
            self._temperature.publish(reading)

    def publish_valve_state(self, state: ValveState) -> None:
        """Publish what the valves got in a cycle."""
        publisher, message = self._valves
        with self._stating:
            values = (state.voltages, state.spools) if self._has_spools else (state.voltages,)
            publisher.publish(message.filled(state.stamp_ns, *values))

    def destroy(self) -> None:
        """Take the publishers off the graph."""
        publishers = [self._joints[0], self._pressures[0], self._valves[0]]
        publishers += [publisher for _, publisher in self._slow]
        publishers += [] if self._temperature is None else [self._temperature]
        for publisher in publishers:
            self._node.destroy_publisher(publisher)
