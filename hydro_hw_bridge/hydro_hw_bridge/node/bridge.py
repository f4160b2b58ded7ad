"""The lifecycle node around `BridgeLoops`: parameters, bus, services, diagnostics."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus, quiet_python_can
from hydro_hw_bridge.bus.claims import CLAIM_PERIOD_S, Claim
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.node import bridge_report
from hydro_hw_bridge.node.bridge_loops import BridgeLoops
from hydro_hw_bridge.node.bridge_start import (
    BridgeParts,
    calibration_remarks,
    declared,
    gate_limits,
    loaded_calibration,
    loaded_codec,
    not_quite_zero,
)
from hydro_hw_bridge.node.publishers import BridgePublishers
from hydro_hw_bridge.protocol.calibration import unmeasured
from hydro_hw_bridge.protocol.codec import Codec
from hydro_model.errors import HydroError
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.aside import log_of
from hydro_msgs_docs.nodes import (
    ERROR,
    OK,
    WARN,
    Diagnostics,
    NamesakeError,
    fix_parameters,
    logged_transition,
    refuse_closed_transitions,
    refuse_namesakes,
)
from hydro_msgs_docs.real_time import RealTime

NAME = "can_bridge"
#: The last frames are 0 V so many times: any one may be lost.
LAST_FRAMES = 5
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
        self._reporting = threading.Lock()
        settings = declared(self)
        robot = load_robot(settings.robot)
        calibration = loaded_calibration(settings)
        codec, self._names = loaded_codec(settings, robot, calibration)
        self._unmeasured = unmeasured(codec.mapping, calibration) if calibration else ""
        limits = gate_limits(settings, robot)
        self._log = log_of(self)
        real_time = RealTime(settings.real_time, self._log.warn)
        bus: Bus = open_bus(settings.can, (*codec.device_ids, *codec.bridge_ids))
        claim = _taken(bus, codec)
        self._parts = BridgeParts(settings, codec, limits, bus, claim, real_time)
        self._log.info(
            f"{robot.name} on {bus.name}, {settings.clock}: {codec.layout.describe_load()}"
        )
        remarks = calibration_remarks(codec.mapping, calibration)
        for line in (*remarks, *not_quite_zero(codec)):
            self._log.warn(line)
        self._diagnostics = Diagnostics(self, f"{robot.name}@{bus.name}")
        self._topics: BridgePublishers | None = None
        self._summary = ("", "")
        self._state: tuple[object, ...] = ()
        self._loops = BridgeLoops(self, self._parts, self._on_change, self.fail)
        self.create_service(Trigger, "~/clear_trip", self._clear_trip)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(CLAIM_PERIOD_S, self._every_claim, clock=steady)
        self.create_timer(1.0, self._publish_diagnostics, clock=steady)
        refuse_closed_transitions(self)
        fix_parameters(self, lambda: self._loops.running)

    # -- lifecycle

    def _configure(self) -> None:
        parts = self._parts
        self._topics = BridgePublishers(
            self, parts.codec, parts.limits.period_s, parts.settings.slow_rate_hz
        )
        self._loops.start(self._topics)

    def _activate(self) -> None:
        if self._unmeasured:
            raise BridgeError(self._unmeasured)
        self._loops.activate(self._refuse_at_the_end)

    def _refuse_at_the_end(self) -> None:
        if self._stop.is_set():
            raise BridgeError("the bridge is ending, expected one that goes on")

    def _deactivate(self) -> None:
        self._loops.deactivate()

    def _cleanup(self) -> None:
        self._deactivate()
        self._loops.stop()
        # Now nobody else sends: whatever was lost before, this is the last that is heard.
        if self._loops.core.spoke:
            self._loops.send_zero(LAST_FRAMES)
        if self._topics is not None:
            self._topics.destroy()
            self._topics = None

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
        self._parts.bus.close()
        self._log.close()

    # -- ends

    def end(self) -> None:
        """Valves to 0 V now, from any thread; the process ends, and drives no more until then."""
        self._stop.set()
        self._deactivate()

    def fail(self, error: Exception) -> None:
        """Valves to 0 V, and tell the process to end with this error."""
        known = isinstance(error, HydroError)
        text = str(error) if known else f"{type(error).__name__}: {error}"
        self.failure = self.failure or text  # what comes later may follow from it
        self.end()
        # The last that is heard of this node: what merely stops does not say why.
        self._publish_diagnostics()

    # -- executor

    def _every_claim(self) -> None:
        self._loops.claim_again()
        self._on_change()

    def _clear_trip(self, _request: Any, response: Any) -> Any:
        try:
            refuse_namesakes(self)
        except NamesakeError as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = self._loops.clear_trip()
        self._log.info(f"clear_trip: {response.message}")
        self._on_change()
        return response

    def _on_change(self) -> None:
        state = self._loops.state()
        if state != self._state:
            self._state = state
            self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        # One at a time: the states that threads report keep their order.
        with self._reporting:
            level, text, values = self._loops.report(self._names)
            if self.failure:
                level, text = bridge_report.ERROR, self.failure
            # A failure is the last line of the command itself.
            if (level, text) != self._summary and not self.failure:
                self._summary = (level, text)
                # Threads that must not wait come by here: that which ends the process among them.
                say = self._log.error if level == bridge_report.ERROR else self._log.info
                say(text)
            self._diagnostics.publish(LEVELS[level], text, values)


def _taken(bus: Bus, codec: Codec) -> Claim:
    """The claim on a bus that nobody else drives; the bus is closed where it is not to be had."""
    claim = Claim(bus, codec)
    try:
        claim.take()
    except BaseException:
        bus.close()
        raise
    return claim
