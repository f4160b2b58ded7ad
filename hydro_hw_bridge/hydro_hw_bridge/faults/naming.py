"""What a fault has to show as in the bridge's own `/diagnostics`, and where nothing can show."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.node import bridge_report

NONE_SHOWS = "several at once, none of which can show"
#: Faults of which the bridge cannot know, each with the reason. Published as it stands here.
SILENT: dict[str, str] = {
    "valve frames late, and still in time": (
        "the amplifiers take commands up to 10 ms old, as promised: that is no fault yet"
    ),
    "commands late, and still in time": "up to 10 ms a command may be old: that is no fault yet",
    "no commands for less than 10 ms": (
        "up to 10 ms the last command holds: that is no fault yet; `answer_*` tells such times"
    ),
    "a bridge that is dead": "nobody is left to say it: diagnostics that stop are the sign",
    "a bridge that stood still for less than 10 ms": (
        "its commands are no older than they may be; `loop_*` tells such times"
    ),
    "a machine in lockstep that is silent": (
        "it may be, and so may an interface that is gone for a while: its time stands still; after"
        " 2.5 s without a frame the summary says so"
    ),
    "a step of the ROS clock": "it is read once, at the first cycle: nothing changes",
    "an encoder stuck for less than 0.5 s": "a joint at rest reads the same",
    "a pressure stuck for less than 2 s": "a pressure at rest may read the same for a while",
    NONE_SHOWS: "as each of them",
}
#: Counters that grow with faults only.
_OF_FAULTS = re.compile(
    r"trips|cycles_(?!complete)|commands_(?!accepted|not_driving)|readings_(?!last)"
    r"|valve_frames_|bus_(dropped|send_errors|error_frames)$"
)


@dataclass(frozen=True, slots=True)
class Named:
    """What a fault has to show as.

    Attributes
    ----------
    shows : tuple of str
        Counters of which one at least has to grow.
    says : str
        Regular expression that has to be found in the trip's reason, in what was found wrong with
        readings last, or in the summary; empty: anything may stand there.
    silent : str
        Key of `SILENT` where nothing has to show.
    """

    shows: tuple[str, ...] = ()
    says: str = ""
    silent: str = ""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a bridge's diagnostics say at one moment.

    Attributes
    ----------
    counters : mapping of str to int
        By the key under which they are published.
    texts : tuple of str
        Summary, reason of the trip and what was found wrong with readings last.
    """

    counters: Mapping[str, int]
    texts: tuple[str, ...]

    @classmethod
    def of(cls, core: BridgeCore, bus: Bus) -> Diagnosis:
        """The diagnosis of a bridge now.

        Parameters
        ----------
        core : BridgeCore
        bus : Bus
            Its end of it.
        """
        values = bridge_report.values(core, bus, {})
        summary = bridge_report.summary(core, [], silent=False)[1]
        return cls(
            {key: value for key, value in values.items() if isinstance(value, int)},
            (summary, str(values["trip_reason"]), str(values["readings_last_fault"])),
        )

    def grown(self, before: Diagnosis) -> frozenset[str]:
        """Counters of faults that grew since then.

        Parameters
        ----------
        before : Diagnosis
            Of the same bridge.
        """
        return frozenset(
            key
            for key, value in self.counters.items()
            if _OF_FAULTS.match(key) and value > before.counters[key]
        )

    def lacks(self, named: Named, before: Diagnosis) -> list[str]:
        """What had to show and does not, in words.

        Parameters
        ----------
        named : Named
        before : Diagnosis
            Of the same bridge before the fault.
        """
        if named.silent:
            return []
        missing = []
        if named.shows and not self.grown(before) & set(named.shows):
            missing.append(f"shows in none of {', '.join(named.shows)}")
        if named.says and not any(re.search(named.says, text) for text in self.texts):
            found = " | ".join(text for text in self.texts if text)
            missing.append(f"said nowhere: '{named.says}' (found: {found})")
        return missing
