"""The lifecycle node around `BridgeCore`: threads, services, bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from hydro_hw_bridge import bridge_report
from hydro_hw_bridge.bridge_core import BridgeCore
from hydro_hw_bridge.bridge_start import declared, gate_limits, loaded_codec
from hydro_hw_bridge.bridge_step import NOTHING, Step
from hydro_hw_bridge.bridge_times import BridgeTimes
from hydro_hw_bridge.bus import Bus
from hydro_hw_bridge.bus_open import open_bus, quiet_python_can
from hydro_hw_bridge.claims import CLAIM_PERIOD_S, Claim
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.frames import Frame
from hydro_hw_bridge.link import CommandLink
from hydro_hw_bridge.parameters import LOCKSTEP
from hydro_hw_bridge.publishers import BridgePublishers
from hydro_hw_bridge.supervision import FOREIGN
from hydro_model.errors import HydroError
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.hot_loop import HotWait
from hydro_msgs_docs.hot_messages import HotVectors
from hydro_msgs_docs.nodes import ERROR, OK, WARN, Diagnostics, fix_parameters, logged_transition
from hydro_msgs_docs.real_time import RealTime
from hydro_msgs_docs.topics import VALVE_COMMAND, reliable

NAME = "can_bridge"
RECEIVE_TIMEOUT_S = 0.005
#: Silence is told by a bus on which nothing waits; where something always does, after this.
LONGEST_SILENCE_S = 0.05
COMMAND_TIMEOUT_S = 0.5
#: Longer than a device in lockstep takes to repeat a cycle.
SILENT_S = 2.5
JOIN_S = 2.0
#: The last frames are 0 V so many times, this far apart, tried for as long where refused.
LAST_FRAMES, LAST_PERIOD_S, LAST_S = 5, 0.002, 0.2
SECOND_BRIDGE = "second_bridge"
LEVELS = {bridge_report.OK: OK, bridge_report.WARN: WARN, bridge_report.ERROR: ERROR}


class CanBridge(LifecycleNode):
    """The bridge node.

    Everything that can be wrong at the start (parameters, files, bus, a second bridge) raises
    here; threads run from `configure` to `cleanup`.

    Parameters
    ----------
    stop : threading.Event
        Set by the node when it cannot go on.

    Attributes
    ----------
    failure : str
        Why it could not go on; empty otherwise.

    Raises
    ------
    HydroError
    """

    def __init__(self, stop: threading.Event) -> None:
        super().__init__(NAME)
        quiet_python_can()
        self.failure = ""
        self._stop = stop
        self._lock = threading.Lock()
        self._reporting = threading.Lock()
        self._settings = declared(self)
        robot = load_robot(self._settings.robot)
        self._codec, self._names = loaded_codec(self._settings, robot)
        self._limits = gate_limits(self._settings, robot)
        self._real_time = RealTime(self._settings.real_time, self.get_logger().warn)
        self._times = self._new_times()
        bus_name = self._settings.can
        ids = (*self._codec.device_ids, *self._codec.bridge_ids)
        self._bus: Bus = open_bus(bus_name, ids)
        self._link = CommandLink(self._bus, self._limits.max_age_cycles)
        self._core = self._new_core()
        self._claim = Claim(self._bus, self._codec)
        try:
            self._claim.take()
        except BaseException:
            self._bus.close()
            raise
        self.get_logger().info(
            f"{robot.name} on {self._bus.name}, {self._settings.clock}:"
            f" {self._codec.layout.describe_load()}"
        )
        self._diagnostics = Diagnostics(self, f"{robot.name}@{self._bus.name}")
        self._hot = HotVectors(self, VALVE_COMMAND, reliable())
        self._wait = HotWait(self, self._hot)
        self.create_service(Trigger, "~/clear_trip", self._clear_trip)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(CLAIM_PERIOD_S, self._every_claim, clock=steady)
        self.create_timer(1.0, self._publish_diagnostics, clock=steady)
        self._topics: BridgePublishers | None = None
        self._threads: list[threading.Thread] = []
        self._running = threading.Event()
        fix_parameters(self, self._running.is_set)
        self._heard_at = self._foreign_at = time.monotonic()
        self._summary = ("", "")
        self._state: tuple[object, ...] = ()

    def _new_core(self) -> BridgeCore:
        lockstep = self._settings.clock == LOCKSTEP
        return BridgeCore(self._codec, self._limits, lockstep=lockstep, send=self._link.send)

    def _new_times(self) -> BridgeTimes:
        return BridgeTimes(self._limits.period_s, lockstep=self._settings.clock == LOCKSTEP)

    # -- lifecycle

    def _configure(self) -> None:
        core = self._new_core()
        with self._lock:
            core.carry_over(self._core)
            self._core = core
        settings = self._settings
        self._topics = BridgePublishers(
            self, self._codec, self._limits.period_s, settings.slow_rate_hz
        )
        self._running.set()
        self._threads = [
            threading.Thread(target=self._guarded, args=(body,), name=name, daemon=True)
            for name, body in (("can", self._receive_loop), ("command", self._command_loop))
        ]
        self._times = self._new_times()
        self._real_time.prepare()
        for thread in self._threads:
            thread.start()

    def _activate(self) -> None:
        with self._lock:
            if self._stop.is_set():
                raise BridgeError("the bridge is ending, expected one that goes on")
            self._core.activate(ready=not self._settings.required_subscribers)

    def _deactivate(self) -> None:
        with self._lock:
            refused = (
                self._core.active
                and self._core.deactivate() is None
                and self._core.sample is not None
            )
        if refused:
            self._send_zero(1)

    def _cleanup(self) -> None:
        self._deactivate()
        self._running.clear()
        self._wait.wake()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(JOIN_S)
        self._threads = []
        self._real_time.leave()
        # Now nobody else sends: whatever was lost before, this is the last that is heard.
        if self._core.spoke:
            self._send_zero(LAST_FRAMES)
        if self._topics is not None:
            self._topics.destroy()
            self._topics = None

    def _send_zero(self, frames: int) -> None:
        """0 V and enable off so many times; again where the bus does not take it, for a while."""
        end = time.monotonic() + LAST_S
        while frames > 0 and time.monotonic() < end:
            with self._lock:
                frames -= self._core.send_zero() is not None
            time.sleep(LAST_PERIOD_S)

    on_configure = logged_transition(_configure)
    on_activate = logged_transition(_activate)
    on_deactivate = logged_transition(_deactivate)
    on_cleanup = logged_transition(_cleanup)
    on_shutdown = logged_transition(_cleanup)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """An exception in a transition: valves to 0 V, back to unconfigured."""
        self._cleanup()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Valves to 0 V, threads ended, bus closed."""
        self._cleanup()
        self._bus.close()

    # -- threads

    def end(self) -> None:
        """Valves to 0 V now, from any thread; the process ends, and drives no more until then."""
        self._stop.set()
        self._deactivate()

    def fail(self, error: Exception) -> None:
        """Valves to 0 V, and tell the process to end with this error."""
        known = isinstance(error, HydroError)
        self.failure = str(error) if known else f"{type(error).__name__}: {error}"
        self.end()
        # The last that is heard of this node: what merely stops does not say why.
        self._publish_diagnostics()

    def _guarded(self, body: Callable[[], None]) -> None:
        try:
            self._real_time.enter()
            body()
        except Exception as error:  # noqa: BLE001 - whatever ends a thread must stop the valves
            self.fail(error)

    def _receive_loop(self) -> None:
        clock = self.get_clock()
        while self._running.is_set():
            message = self._bus.receive(RECEIVE_TIMEOUT_S)
            begin_ns = time.monotonic_ns()
            frame = None if message is None else self._codec.receive(message)
            now_ns, waited_s = 0, None
            heard_at = self._heard_at
            if message is not None and frame is not None and frame.role == "sync" and frame.intact:
                heard_at = time.monotonic()
                now_ns = clock.now().nanoseconds
                waited_s = self._bus.waited_s(message)
            if frame is not None and frame.role == "claim":
                if frame.intact and self._claim.hear(self._codec.decode_claim(frame)):
                    self._second_bridge()
                frame = None
            with self._lock:
                # Not before: until a frame is judged, commands are as old as the one before it.
                self._heard_at = heard_at
                first = NOTHING if frame is None else self._received(frame, now_ns)
                late = () if waited_s is None else self._read_late(waited_s)
                # What is wrong with the bus is news after an error frame, which is no message,
                # after sending, and once a cycle in any case.
                news = message is None or waited_s is not None or first.answer is not None
                bus = self._look_at_bus() if news else ()
                steps = (first, *late, self._silence(message is None), *bus)
            self._times.arrived(first.sample, begin_ns)
            self._publish(*steps)
            self._times.published(first.sample, begin_ns)
            if message is None or first.sample is not None:
                self._real_time.idle()

    def _received(self, frame: Frame, now_ns: int) -> Step:
        """With the lock: what follows from a frame."""
        if frame.role != "command":
            return self._core.receive(frame, now_ns)
        if not frame.intact:
            return NOTHING
        before = self._core.commands.foreign
        step = self._core.hear_command(frame)
        if self._core.commands.foreign != before:
            self._foreign_at = time.monotonic()
        return step

    def _read_late(self, waited_s: float) -> tuple[Step, Step]:
        """With the lock: what follows from when a sync frame came."""
        return self._core.waited(waited_s), self._core.paced(self._heard_at - waited_s)

    def _silence(self, nothing_waits: bool) -> Step:
        """With the lock: what follows from how long the device said nothing.

        After a stall of this process what the device said meanwhile waits to be read first.
        """
        silence_s = time.monotonic() - self._heard_at
        if not nothing_waits and silence_s < LONGEST_SILENCE_S:
            return NOTHING
        return self._core.silence(silence_s)

    def _command_loop(self) -> None:
        while self._running.is_set():
            if not self._wait.wait(COMMAND_TIMEOUT_S):
                continue
            while (taken := self._hot.take_numbered()) is not None:
                asked, number = taken
                with self._lock:
                    unheard_s = time.monotonic() - self._heard_at
                    step = self._core.command(
                        asked.stamp_ns, asked.name, asked.effort, number, unheard_s
                    )
                    steps = (step, *self._look_at_bus())
                self._times.commanded(step, asked.stamp_ns)
                self._publish(*steps)

    def _look_at_bus(self) -> list[Step]:
        """With the lock: what follows from the state of the bus."""
        return [self._core.condition(*condition) for condition in self._link.conditions()]

    def _publish(self, *steps: Step) -> None:
        """Without the lock: publishing may take its time, the frames have been sent."""
        publishers = self._topics
        if publishers is None:
            return
        for step in steps:
            if step is NOTHING:
                continue
            if step.sample is not None:
                # Before publishing: the answer to this sample may come at once.
                self._look_for_subscribers()
                publishers.publish_sample(step.sample)
            for state in step.valve_states:
                publishers.publish_valve_state(state)
            self._on_change()

    def _look_for_subscribers(self) -> None:
        if not self._core.active or self._core.ready:
            return
        publishers = self._topics
        if publishers is None or publishers.matched(self._settings.required_subscribers):
            return
        with self._lock:
            self._core.ready = self._core.active

    def _second_bridge(self) -> None:
        with self._lock:
            step = self._core.fault(SECOND_BRIDGE, "a second bridge is on the bus")
        self._publish(step)

    # -- executor

    def _every_claim(self) -> None:
        self._claim.send()
        if self._claim.others_gone():
            with self._lock:
                self._core.gate.end_fault(SECOND_BRIDGE)
        if time.monotonic() - self._foreign_at > CLAIM_PERIOD_S:
            with self._lock:
                self._core.gate.end_fault(FOREIGN)
        self._on_change()

    def _clear_trip(self, _request: Any, response: Any) -> Any:
        with self._lock:
            response.success, response.message = self._core.gate.clear()
        self.get_logger().info(f"clear_trip: {response.message}")
        self._on_change()
        return response

    def _on_change(self) -> None:
        with self._lock:
            core, gate = self._core, self._core.gate
            state = (core.active, core.ready, gate.state, gate.trips, len(gate.faults))
        if state != self._state:
            self._state = state
            self._publish_diagnostics()

    def _report(self) -> tuple[str, str, dict[str, object]]:
        """Level, summary and values of one and the same moment."""
        publishers = self._topics
        silent = bool(self._threads) and time.monotonic() - self._heard_at > SILENT_S
        missing = (
            publishers.matched(self._settings.required_subscribers)
            if publishers is not None and self._core.active and not self._core.ready
            else []
        )
        with self._lock:
            level, text = bridge_report.summary(self._core, missing, silent=silent)
            values = bridge_report.values(self._core, self._bus, self._names)
        if self.failure:
            level, text = bridge_report.ERROR, self.failure
        return level, text, values | self._times.values() | self._real_time.values()

    def _publish_diagnostics(self) -> None:
        # One at a time: the states that threads report keep their order.
        with self._reporting:
            level, text, values = self._report()
            # A failure is the last line of the command itself.
            if (level, text) != self._summary and not self.failure:
                self._summary = (level, text)
                # Two calls: rclpy binds one severity to each place that logs.
                if level == bridge_report.ERROR:
                    self.get_logger().error(text)
                else:
                    self.get_logger().info(text)
            self._diagnostics.publish(LEVELS[level], text, values)
