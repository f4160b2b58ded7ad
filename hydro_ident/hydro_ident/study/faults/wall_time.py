"""The smaller part of the campaign: real processes, and the wall clock at the rig's valves."""

from __future__ import annotations

import json
import random
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from hydro_hw_bridge.faults.naming import Diagnosis, Named
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_ident.errors import IdentError
from hydro_ident.study.faults.promised import ALL_FRAMES_MS
from hydro_ident.study.faults.ros_end import ACTIVATE, CONFIGURE, RosEnd
from hydro_ident.study.faults.stage import Stage, executable, until
from hydro_ident.study.faults.valve_record import excess_v
from hydro_ident.study.faults.wall_outcomes import Judgement, WallOutcome, judgement, worst_of

#: So often the valves are looked at for a stop.
SEEN_S = 0.002
#: After a stop the valves are watched for so long.
LATCHED_S = 0.15
#: So long after a trip was cleared its first second of driving is past, or was looked at.
SLOW_NS = 20_000_000_000
#: Why nothing can be said of a fault that a busy computer was ahead of.
NOT_DRIVEN = "the valves were not driven any more as the fault began"
#: A computer that cannot drive for so long is too busy: the injection is left out, and counted.
DRIVING_S = 30.0


class WallRun:
    """Runs injections on a stage.

    Parameters
    ----------
    stage : Stage
    ros : RosEnd
    limits : GateLimits
    buses : (str, str)
        Of the machine and of the bridge; different ones have the proxy between them.
    """

    def __init__(
        self, stage: Stage, ros: RosEnd, limits: GateLimits, buses: tuple[str, str]
    ) -> None:
        self.stage, self.ros, self.limits = stage, ros, limits
        self.machine_bus, self.bridge_bus = buses
        self.unasked_trips = 0
        self._cleared_ns: int | None = None

    def begin(self) -> None:
        """Start machine, proxy, timer and bridge, and drive."""
        self.stage.start_timer()
        self.stage.start_rig(self.machine_bus)
        self._start_proxy()
        self.start_bridge()

    def recover(self) -> None:
        """Start again what a fault that could not be judged left without."""
        if not self.stage.running("rig"):
            self.stage.start_rig(self.machine_bus)
        if not self.stage.running("bridge"):
            self.start_bridge()

    def _start_proxy(self) -> None:
        module = "hydro_hw_bridge.faults.proxy"
        words = (sys.executable, "-m", module, self.machine_bus, self.bridge_bus)
        self.stage.start("proxy", *words, ready="ready")

    def start_bridge(self, bus: str = "") -> None:
        """A bridge, configured and activated; on another `bus` than its own where one is named."""
        self._cleared_ns = None  # a new one knows of no trip
        words = ("--ros-args", "-p", f"can:={bus or self.bridge_bus}", "-p", "clock:=real_time")
        self.stage.start(
            "bridge", executable("hydro_hw_bridge", "can_bridge"), *words, ready="bus load"
        )
        for number in (CONFIGURE, ACTIVATE):
            if not self.ros.transition("can_bridge", number):
                raise IdentError(f"the bridge refused a transition: {self.stage.said('bridge')}")

    def start_controller(self) -> None:
        """The real controller, holding where the machine is."""
        self.ros.publishing = False
        self.stage.start("controller", executable("hydro_control", "controller"))
        for number in (CONFIGURE, ACTIVATE):
            if not self.ros.transition("controller", number):
                raise IdentError("the controller refused a transition")

    def drive(self, *, publishing: bool = True) -> None:
        """Until the valves are driven: trips that the busy computer makes are cleared.

        `publishing` says whether the commands come from here, or from the controller, of which
        there is one then and otherwise none. The first trip is what the injection before left.
        """
        if publishing:
            self.stage.end("controller")
        elif not self.stage.running("controller"):
            self.start_controller()
        self.ros.publishing = publishing
        end = time.monotonic() + DRIVING_S
        cleared = 0
        while not self.stage.driven():
            if time.monotonic() > end:
                raise IdentError("the valves are not driven: the computer is too busy")
            gate = self.ros.diagnosis.get("can_bridge", {}).get("gate")
            if gate == "tripped":
                if publishing:
                    self.ros.end_fault()
                now_ns = time.monotonic_ns()
                # The diagnosis is a second old at most: only what was cleared was a trip.
                if self.ros.clear_trip()[1].startswith("cleared"):
                    cleared += 1
                    self._cleared_ns = now_ns
            time.sleep(0.03)
        self.unasked_trips += max(cleared - 1, 0)
        self.stage.mark()

    def measured(
        self, kind: str, since_ns: int, limit_ms: float | None, *, latched: bool = True
    ) -> WallOutcome:
        """What followed at the valves.

        `latched` says whether the fault has to leave the gate tripped. Of valves that were not
        driven any more as it began nothing can be said: 0 V would be no answer to it.
        """
        if not self.stage.driven_at(since_ns):
            time.sleep(LATCHED_S)
            return WallOutcome(kind, limit_ms, None, 0.0, "", excused=NOT_DRIVEN)
        stop_ms, broken = None, ""
        if limit_ms is not None:
            deadline = time.monotonic() + 2.0
            while (at := self.stage.first_stop_ns(since_ns)) is None:
                if time.monotonic() > deadline:
                    return WallOutcome(kind, limit_ms, None, 0.0, "not at 0 V within 2 s")
                # Soon: what waited for a core is counted until then.
                time.sleep(SEEN_S)
            stop_ms = (at - since_ns) / 1e6
            waited_ms = self.stage.waited_ms(publishing=self.ros.publishing)
            time.sleep(LATCHED_S)
            if latched and self.stage.moved_ns(at) is not None:
                broken = "the valves moved again without being cleared"
        else:
            time.sleep(LATCHED_S)
            waited_ms = self.stage.waited_ms(publishing=self.ros.publishing)
        broken = broken or self._leapt(since_ns)
        span_ns = int(1e6 * (stop_ms or 0.0))
        late_ms = self._timer_ms(since_ns, span_ns)
        return WallOutcome(kind, limit_ms, stop_ms, late_ms, broken, waited_ms=waited_ms)

    def _leapt(self, until_ns: int) -> str:
        """A step too large in the second after the trip was cleared, in words.

        Looked at is what came to the valves before a fault, as by `until_ns`.
        """
        if self._cleared_ns is None or until_ns - self._cleared_ns > SLOW_NS:
            return ""
        at, values = self.stage.valves(self._cleared_ns)
        excess = excess_v(values[at < until_ns], self.limits)
        return f"a step {excess:.3f} V too large after re-enabling" if excess > 0.0 else ""

    def drive_and_ask(self) -> Diagnosis:
        """Drive; what the bridge says of itself then, before a fault."""
        self.drive()
        now = self.diagnosed()
        self.drive()  # it may have tripped meanwhile
        return now

    def _timer_ms(self, since_ns: int, span_ns: int) -> float:
        """Greatest lateness of the bare timer in a span, 20 ms about it."""
        at, late = self.stage.timer_lateness()
        near = (at + late >= since_ns - 20_000_000) & (at <= since_ns + span_ns + 20_000_000)
        return float(late[near].max() / 1e6) if near.any() else 0.0

    # -- injections

    def until_tripped(self) -> str:
        """Wait until the bridge says that it has tripped; for which reason."""
        # Its newest diagnosis may be of before, with the reason of a trip that was cleared.
        end = time.monotonic() + 5.0
        while not (reason := self.diagnosed().texts[1]):
            if time.monotonic() > end:
                raise IdentError("expected the bridge to trip within 5 s")
        return reason

    def diagnosed(self) -> Diagnosis:
        """What the bridge says of itself from now on: its next diagnostics."""
        seen = self.ros.diagnosis.get("can_bridge")
        until(lambda: self.ros.diagnosis.get("can_bridge") is not seen, 5.0, "diagnostics")
        values = self.ros.diagnosis["can_bridge"]
        counters = {key: int(v) for key, v in values.items() if v.isdecimal()}
        texts = (values["message"], values["trip_reason"], values["readings_last_fault"])
        return Diagnosis(counters, texts)

    def not_shown(self, named: Named, before: Diagnosis, *, drives_on: bool) -> Judgement:
        """What had to show in the bridge's next diagnostics and does not.

        `named` is what had to, `before` the diagnosis before the fault; `drives_on` says whether
        nothing may trip.
        """
        now = self.diagnosed()
        reason = now.texts[1]
        missing = now.lacks(named, before)
        if drives_on and reason:
            missing.append(f"tripped: {reason}")
        return judgement(missing, reason)

    def tripped(self) -> Judgement:
        """Where nothing may trip: what the bridge's next diagnostics say."""
        reason = self.diagnosed().texts[1]
        return judgement([f"the bridge tripped: {reason}"] if reason else [], reason)

    def bus_fault(self, kind: str, direction: str, source: random.Random) -> WallOutcome:
        """The proxy loses, delays or flips the frames of one direction for 0.2 s.

        `kind` and `direction` are those of a `BusFault`; `source` draws the rest.
        """
        fault: dict[str, Any] = {"kind": kind, "cycles": 100, "direction": direction}
        fault |= {"seed": source.randrange(1 << 30), "amount": source.randint(8, 12)}
        self.drive()
        since = self.put_on_the_bus(fault)
        limit_ms = ALL_FRAMES_MS[kind, direction]
        return self.measured(f"bus: {kind} ({direction})", since, limit_ms)

    def put_on_the_bus(self, fault: dict[str, Any]) -> int:
        """Let the proxy begin a fault; the monotonic time, ns, at which it did.

        `fault` holds the fields of a `BusFault` without its first cycle.
        """
        return self.stage.tell_timed("proxy", json.dumps(fault))

    def parameters(self, source: random.Random) -> WallOutcome:
        """A parameter that `source` draws is set while driving: refused, and driven on."""
        self.drive()
        name, value = source.choice((("slew_limit_v_s", 9e4), ("max_age_ms", 40.0)))
        since = time.monotonic_ns()
        taken = self.ros.set_parameter("can_bridge", name, value)
        found = self.measured("parameters changed while driving", since, None)
        return worst_of(worst_of(found, f"{name} was taken" if taken else ""), self.tripped())

    def deeds(self) -> dict[str, Callable[[random.Random], WallOutcome]]:
        """Injections by kind, without those of processes and of the machine's two ends."""
        deeds: dict[str, Callable[[random.Random], WallOutcome]] = {
            f"bus: {kind} ({direction})": partial(self.bus_fault, kind, direction)
            for kind, direction in ALL_FRAMES_MS
        }
        deeds["parameters changed while driving"] = self.parameters
        return deeds
