"""What follows from what came, and when: all that the bridge's threads decide, without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hydro_hw_bridge.bus.claims import CLAIM_PERIOD_S, Claim
from hydro_hw_bridge.bus.link import CommandLink
from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.core.supervision import FOREIGN
from hydro_hw_bridge.protocol.bridge_step import NOTHING, Step
from hydro_hw_bridge.protocol.frames import Frame

#: Silence is told by a bus that is read up to the present; where nothing tells that, after this.
LONGEST_SILENCE_S = 0.05
#: Longer than a device in lockstep takes to repeat a cycle.
SILENT_S = 2.5
#: Name of the fault of a second bridge.
SECOND_BRIDGE = "second_bridge"


@dataclass(frozen=True, slots=True)
class Arrival:
    """When a sync frame came.

    Attributes
    ----------
    read_s : float
        Read from the bus, on a clock that never steps.
    waited_s : float
        It had waited for so long by then.
    ros_ns : int
        ROS time at which it came.
    """

    read_s: float
    waited_s: float
    ros_ns: int


def tells_time(frame: Frame | None) -> bool:
    """Whether a frame is one by which time is counted: others may be anybody's.

    Parameters
    ----------
    frame : Frame or None
    """
    return frame is not None and frame.role == "sync" and frame.intact


class BridgeTurns:
    """One turn after the other of the threads around a core.

    Callers hold one lock around every method, and say what time it is, s, on a clock that never
    steps.

    Parameters
    ----------
    core : BridgeCore
    link : CommandLink
        By which the core sends.
    claim : Claim
    now_s : float

    Attributes
    ----------
    core : BridgeCore
    """

    def __init__(self, core: BridgeCore, link: CommandLink, claim: Claim, now_s: float) -> None:
        self.core = core
        self._link, self._claim = link, claim
        self._heard_s = self._advanced_s = self._whole_s = self._foreign_s = now_s

    def begin(self, core: BridgeCore) -> None:
        """A new core, which takes over what must outlive the one before.

        Parameters
        ----------
        core : BridgeCore
        """
        core.carry_over(self.core)
        self.core = core

    # -- what comes

    def received(
        self,
        frame: Frame | None,
        arrival: Arrival | None,
        now_s: float,
        *,
        idle: bool,
        read_to_s: float | None = None,
    ) -> tuple[Step, ...]:
        """The bus was read.

        Parameters
        ----------
        frame : Frame or None
            None where there was none, or none that the bridge listens to.
        arrival : Arrival or None
            Of a frame that `tells_time`.
        now_s : float
        idle : bool
            Nothing waits on the bus.
        read_to_s : float, optional
            What came up to then has been read: when this frame came, whatever it is. None where
            the interface does not tell.

        Returns
        -------
        tuple of Step
            Of the frame itself first.
        """
        counter, whole = self.core.assembler.counter, self.core.assembler.whole
        steps = [NOTHING if frame is None else self._frame(frame, arrival, now_s)]
        if arrival is not None:
            if self.silent(arrival.read_s):
                self._whole_s = arrival.read_s  # nothing was lacking while nothing was said
            self._heard_s = arrival.read_s
            if self.core.assembler.counter != counter:
                # One that says the same again, or comes from afar, makes no command younger.
                self._advanced_s = arrival.read_s
        if self.core.assembler.whole != whole:
            self._whole_s = now_s
        if arrival is not None:
            steps.append(self.core.waited(arrival.waited_s))
            steps.append(self.core.paced(arrival.read_s - arrival.waited_s))
        steps.append(self._silence(frame, now_s if idle else read_to_s, now_s))
        # What is wrong with the bus is news after an error frame, which is no message, after
        # sending or failing to, and once a cycle in any case.
        if idle or arrival is not None or self._link.tried:
            steps += self._bus()
        return tuple(steps)

    def _frame(self, frame: Frame, arrival: Arrival | None, now_s: float) -> Step:
        if frame.role not in ("command", "claim"):
            return self.core.receive(frame, 0 if arrival is None else arrival.ros_ns)
        if not frame.intact:
            return NOTHING
        if frame.role == "claim":
            other = self._claim.hear(self.core.codec.decode_claim(frame))
            reason = "a second bridge is on the bus"
            return self.core.fault(SECOND_BRIDGE, reason) if other else NOTHING
        before = self.core.commands.foreign
        step = self.core.hear_command(frame)
        if self.core.commands.foreign != before:
            self._foreign_s = now_s
        return step

    def _silence(self, frame: Frame | None, read_to_s: float | None, now_s: float) -> Step:
        """What follows from how long the device began no new cycle.

        After a stall of this process what the device said meanwhile waits to be read first: up to
        when the bus has been read is told by when the frame at hand came, or by a bus without one.
        """
        silence_s = now_s - self._advanced_s
        if silence_s < LONGEST_SILENCE_S:
            if read_to_s is None:
                return NOTHING
            silence_s = read_to_s - self._advanced_s
        others = frame is not None and frame.role == "cycle"
        return self.core.silence(silence_s, others=others)

    def _bus(self) -> list[Step]:
        """What follows from the state of the bus."""
        return [self.core.condition(*condition) for condition in self._link.conditions()]

    def commanded(
        self,
        stamp_ns: int,
        names: Sequence[str],
        voltages: Sequence[float],
        number: int | None,
        now_s: float,
    ) -> tuple[Step, ...]:
        """A command came.

        Parameters
        ----------
        stamp_ns, names, voltages, number
            As of `BridgeCore.command`.
        now_s : float

        Returns
        -------
        tuple of Step
            Of the command itself first.
        """
        step = self.core.command(stamp_ns, names, voltages, number, now_s - self._advanced_s)
        return (step, *self._bus())

    # -- what is due

    def look_for_others(self, now_s: float) -> None:
        """Every `CLAIM_PERIOD_S`: faults of others on the bus end where these are gone.

        Parameters
        ----------
        now_s : float
        """
        if self._claim.others_gone():
            self.core.gate.end_fault(SECOND_BRIDGE)
        if now_s - self._foreign_s > CLAIM_PERIOD_S:
            self.core.gate.end_fault(FOREIGN)

    def silent(self, now_s: float) -> bool:
        """Whether the device says nothing: longer than one in lockstep does.

        Parameters
        ----------
        now_s : float
        """
        return now_s - self._heard_s > SILENT_S

    def lacking(self, now_s: float) -> bool:
        """Whether the device speaks, and for as long no cycle of it was whole.

        Parameters
        ----------
        now_s : float
        """
        return not self.silent(now_s) and now_s - self._whole_s > SILENT_S

    @property
    def waits(self) -> bool:
        """It drives once its subscribers are there."""
        return self.core.active and not self.core.ready

    def matched(self) -> None:
        """They are there."""
        self.core.ready = self.core.active

    def deactivate(self) -> bool:
        """Drive no more: 0 V now.

        Returns
        -------
        bool
            There is a device, and the bus did not take it.
        """
        core = self.core
        return core.active and core.deactivate() is None and core.sample is not None
