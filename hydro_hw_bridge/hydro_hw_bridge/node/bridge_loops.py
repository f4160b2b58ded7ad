"""The bridge's two 500 Hz threads: frames to samples, commands to frames, one lock around both."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress

from rclpy.lifecycle import LifecycleNode

from hydro_hw_bridge.bus.link import CommandLink
from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.core.bridge_turns import Arrival, BridgeTurns, tells_time
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.node import bridge_report
from hydro_hw_bridge.node.bridge_start import BridgeParts
from hydro_hw_bridge.node.bridge_times import BridgeTimes
from hydro_hw_bridge.node.parameters import LOCKSTEP
from hydro_hw_bridge.node.publishers import BridgePublishers
from hydro_hw_bridge.protocol.bridge_step import NOTHING, Step
from hydro_msgs_docs.hot_loop import HotWait
from hydro_msgs_docs.hot_messages import HotVectors
from hydro_msgs_docs.topics import VALVE_COMMAND, reliable

#: On a silent bus the device's silence is looked at so often: a tenth of the shortest that counts.
RECEIVE_TIMEOUT_S = 0.005
#: Whether to end is looked at so often, should the wake of `stop` be lost: well within `JOIN_S`.
COMMAND_TIMEOUT_S = 0.5
#: A thread that does not end for so long is held, by the bus or by the middleware.
JOIN_S = 2.0
#: 0 V is sent again where the bus does not take it, this far apart and for as long.
LAST_PERIOD_S, LAST_S = 0.002, 0.2


class BridgeLoops:
    """Core, bus and topics of a bridge, and the threads between them.

    Threads run from `start` to `stop`. All else may be called from any thread at any time.

    Parameters
    ----------
    node : LifecycleNode
        Subscribes.
    parts : BridgeParts
    on_change : callable
        Told, without the lock, after whatever may have changed the state.
    on_error : callable
        Told of the exception that ended a thread, from that thread.

    Attributes
    ----------
    times : BridgeTimes
    """

    def __init__(
        self,
        node: LifecycleNode,
        parts: BridgeParts,
        on_change: Callable[[], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._parts, self._on_change, self._on_error = parts, on_change, on_error
        self._lock = threading.Lock()
        self._link = CommandLink(parts.bus, parts.limits.max_age_cycles)
        claim, now_s = parts.claim, time.monotonic()
        self._turns = BridgeTurns(self._new_core(), self._link, claim, now_s)
        self.times = self._new_times()
        self._clock = node.get_clock()
        self._hot = HotVectors(node, VALVE_COMMAND, reliable())
        self._wait = HotWait(node, self._hot)
        self._topics: BridgePublishers | None = None
        self._threads: list[threading.Thread] = []
        # Of the threads that run: one that does not end in time never comes alive again.
        self._running = threading.Event()

    def _new_core(self) -> BridgeCore:
        parts, lockstep = self._parts, self._parts.settings.clock == LOCKSTEP
        return BridgeCore(
            parts.codec,
            parts.limits,
            lockstep=lockstep,
            send=self._link.send,
            hears_itself=parts.bus.hears_itself,
        )

    def _new_times(self) -> BridgeTimes:
        lockstep = self._parts.settings.clock == LOCKSTEP
        return BridgeTimes(self._parts.limits.period_s, lockstep=lockstep)

    # -- from the node

    @property
    def core(self) -> BridgeCore:
        """Since the last `start`; for others to look at."""
        return self._turns.core

    @property
    def running(self) -> bool:
        """Between `start` and `stop`."""
        return self._running.is_set()

    def start(self, topics: BridgePublishers) -> None:
        """Read and publish from now on.

        Parameters
        ----------
        topics : BridgePublishers
            Left alone once `stop` has come back.
        """
        core = self._new_core()
        with self._lock:
            self._turns.begin(core)
        self._drain()
        self._topics = topics
        self._running = running = threading.Event()
        running.set()
        self.times = self._new_times()
        self._parts.real_time.prepare()
        for name, body in (("can", self._receive_loop), ("command", self._command_loop)):
            thread = threading.Thread(
                target=self._guarded, args=(body, running), name=name, daemon=True
            )
            thread.start()
            self._threads.append(thread)

    def _drain(self) -> None:
        """Nobody has read the bus up to now, and what it kept is the oldest that came.

        In lockstep the device says its cycle again, and no time has gone by in it.
        """
        if self._parts.settings.clock != LOCKSTEP:
            with suppress(BridgeError):  # whoever reads next finds the same
                self._parts.bus.drain()

    def stop(self) -> None:
        """End the threads; one that does not end is an error of the bridge, which ends as well."""
        self._running.clear()
        self._wait.wake()
        threads, self._threads = self._threads, []
        others = [thread for thread in threads if thread is not threading.current_thread()]
        for thread in others:
            thread.join(JOIN_S)
        self._topics = None
        self._parts.real_time.leave()
        if held := [thread.name for thread in others if thread.is_alive()]:
            found = f"found {', '.join(held)} held on {self._parts.bus.name}"
            self._on_error(BridgeError(f"expected threads to end within {JOIN_S:g} s, {found}"))

    def activate(self, refuse: Callable[[], None]) -> None:
        """Drive from now on.

        Parameters
        ----------
        refuse : callable
            Raises where it must not be, with nothing in between.
        """
        with self._lock:
            refuse()
            self.core.activate(ready=not self._parts.settings.required_subscribers)

    def deactivate(self) -> None:
        """Drive no more: 0 V now, where there is a device."""
        with self._lock:
            refused = self._turns.deactivate()
        if refused:
            self.send_zero(1)

    def send_zero(self, frames: int) -> None:
        """0 V and enable off so many times; again where the bus does not take it, for a while.

        Parameters
        ----------
        frames : int
        """
        end = time.monotonic() + LAST_S
        while frames > 0 and time.monotonic() < end:
            with self._lock:
                frames -= self.core.send_zero() is not None
            time.sleep(LAST_PERIOD_S)

    def clear_trip(self) -> tuple[bool, str]:
        """As of `Gate.clear`."""
        with self._lock:
            return self.core.gate.clear()

    def claim_again(self) -> None:
        """Every `CLAIM_PERIOD_S`: say who drives here, and forget others that are gone."""
        self._parts.claim.send()
        with self._lock:
            self._turns.look_for_others(time.monotonic())

    def state(self) -> tuple[object, ...]:
        """What others are told of at once where it has changed."""
        with self._lock:
            core, gate = self.core, self.core.gate
            return (core.active, core.ready, gate.state, gate.trips, len(gate.faults))

    def report(self, names: dict[str, str]) -> tuple[str, str, dict[str, object]]:
        """Level, summary and values of one and the same moment, as of `bridge_report`.

        Parameters
        ----------
        names : dict of str to str
            Of robot, mapping and the like.
        """
        topics, required = self._topics, self._parts.settings.required_subscribers
        # Asked first, and whether it waits or not: the middleware's answer may take its time.
        missing = [] if topics is None else topics.matched(required)
        with self._lock:
            running, now_s = bool(self._threads), time.monotonic()
            silent = running and self._turns.silent(now_s)
            lacking = running and self._turns.lacking(now_s)
            level, text = bridge_report.summary(self.core, missing, silent=silent, lacking=lacking)
            values = bridge_report.values(self.core, self._parts.bus, names)
        values["unreadable_commands"] = self._hot.unreadable
        return level, text, values | self.times.values() | self._parts.real_time.values()

    # -- threads

    def _guarded(self, body: Callable[[threading.Event], None], running: threading.Event) -> None:
        try:
            self._parts.real_time.enter()
            body(running)
        except Exception as error:  # noqa: BLE001 - whatever ends a thread must stop the valves
            self._on_error(error)

    def _receive_loop(self, running: threading.Event) -> None:
        bus, codec = self._parts.bus, self._parts.codec
        while running.is_set():
            message = bus.receive(RECEIVE_TIMEOUT_S)
            if not running.is_set():
                break  # whoever runs by now reads for himself
            # First: a stall from here on makes a frame look older, not the bus read further.
            begin_ns = time.monotonic_ns()
            read_s = 1e-9 * begin_ns
            frame, arrival, read_to_s = None, None, None
            if message is not None:
                frame, waited_s = codec.receive(message), bus.waited_s(message)
                read_to_s = read_s - waited_s if bus.tells_waiting else None
                if tells_time(frame):
                    ros_ns = self._clock.now().nanoseconds - round(1e9 * waited_s)
                    arrival = Arrival(read_s, waited_s, ros_ns)
            idle = message is None
            with self._lock:
                steps = self._turns.received(
                    frame, arrival, time.monotonic(), idle=idle, read_to_s=read_to_s
                )
            sample = steps[0].sample
            self.times.arrived(sample, begin_ns)
            self._publish(*steps)
            self.times.published(sample, begin_ns)
            if idle or sample is not None:
                self._parts.real_time.idle()

    def _command_loop(self, running: threading.Event) -> None:
        while running.is_set():
            if not self._wait.wait(COMMAND_TIMEOUT_S):
                continue
            while running.is_set() and (taken := self._hot.take_numbered()) is not None:
                asked, number = taken
                with self._lock:
                    steps = self._turns.commanded(
                        asked.stamp_ns, asked.name, asked.effort, number, time.monotonic()
                    )
                self.times.commanded(steps[0], asked.stamp_ns)
                self._publish(*steps)

    def _publish(self, *steps: Step) -> None:
        """Without the lock: publishing may take its time, the frames have been sent."""
        topics = self._topics
        if topics is None:
            return
        for step in steps:
            if step is NOTHING:
                continue
            if step.sample is not None:
                # Before publishing: the answer to this sample may come at once.
                self._look_for_subscribers(topics)
                topics.publish_sample(step.sample)
            for state in step.valve_states:
                topics.publish_valve_state(state)
            self._on_change()

    def _look_for_subscribers(self, topics: BridgePublishers) -> None:
        with self._lock:
            waits = self._turns.waits
        if not waits or topics.matched(self._parts.settings.required_subscribers):
            return
        with self._lock:
            self._turns.matched()
