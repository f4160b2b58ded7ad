"""Publishers of valve commands that go wrong: commands in, commands out. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from hydro_hw_bridge.faults.timed import Timed

#: What must end at 0 V in the very cycle it is published in.
BAD = (
    "nan",
    "infinite",
    "beyond",
    "unknown_valve",
    "missing_valve",
    "valve_twice",
    "extra_voltage",
    "leap",
    "future",
    "off_grid",
    "second_controller",
)
#: What a sound publisher may do now and then.
HARMLESS = ("twice", "backwards")
KINDS = (*BAD, *HARMLESS, "silent", "late")


@dataclass(frozen=True, slots=True)
class Command:
    """A message of `/valve_command`: stamp in ns, valve names and V."""

    stamp_ns: int
    names: tuple[str, ...]
    voltages: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class CommandFault(Timed):
    """One fault of a publisher.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    first_cycle, cycles : int
    amount : float
        beyond: V; leap: V; late: cycles; second_controller: V.
    valve : int
        Which of them.
    """

    kind: str
    first_cycle: int
    cycles: int = 1
    amount: float = 0.0
    valve: int = 0


class Publisher:
    """What reaches the bridge of a sound controller's commands.

    Parameters
    ----------
    faults : iterable of CommandFault
    period_ns : int

    Attributes
    ----------
    met : set of CommandFault
        Those that had a command to spoil.
    """

    def __init__(self, faults: Iterable[CommandFault], period_ns: int) -> None:
        self._faults = tuple(faults)
        self.met: set[CommandFault] = set()
        self._period_ns = period_ns
        self._held: list[tuple[int, Command]] = []
        self._before: Command | None = None
        self._change: dict[str, Callable[[CommandFault, Command], list[Command]]] = {
            "nan": lambda f, c: [_with(c, f.valve, math.nan)],
            "infinite": lambda f, c: [_with(c, f.valve, math.inf)],
            "beyond": lambda f, c: [_with(c, f.valve, f.amount)],
            "unknown_valve": lambda f, c: [_renamed(c, f.valve, "swing_valve")],
            "missing_valve": lambda f, c: [replace(c, names=c.names[1:], voltages=c.voltages[1:])],
            "valve_twice": lambda f, c: [replace(c, names=(c.names[0],) * len(c.names))],
            "extra_voltage": lambda f, c: [replace(c, voltages=(*c.voltages, 0.0))],
            "leap": lambda f, c: [_with(c, f.valve, _leapt(c.voltages[f.valve], f.amount))],
            "future": lambda f, c: [replace(c, stamp_ns=c.stamp_ns + 50 * period_ns)],
            "off_grid": lambda f, c: [replace(c, stamp_ns=c.stamp_ns + period_ns // 3)],
            "second_controller": lambda f, c: [
                c,
                _with(c, f.valve, _leapt(c.voltages[f.valve], f.amount)),
            ],
            "twice": lambda f, c: [c, c],
            "backwards": lambda f, c: [c] if self._before is None else [c, self._before],
            "silent": lambda f, c: [],
        }

    def take(self, command: Command, cycle: int) -> list[Command]:
        """Publish a command.

        Parameters
        ----------
        command : Command
            Of a sound controller.
        cycle : int

        Returns
        -------
        list of Command
            What the bridge gets now, in this order.
        """
        out = [command]
        for fault in self._faults:
            if not fault.acts(cycle):
                continue
            self.met.add(fault)
            if fault.kind == "late":
                self._held += [(cycle + int(fault.amount), c) for c in out]
                out = []
            else:
                out = [c for one in out for c in self._change[fault.kind](fault, one)]
        self._before = command
        return out

    def due(self, cycle: int) -> list[Command]:
        """Late commands that arrive in this cycle."""
        due = [c for at, c in self._held if at <= cycle]
        self._held = [one for one in self._held if one[0] > cycle]
        return due


def _with(command: Command, valve: int, voltage: float) -> Command:
    voltages = list(command.voltages)
    voltages[valve] = voltage
    return replace(command, voltages=tuple(voltages))


def _renamed(command: Command, valve: int, name: str) -> Command:
    names = list(command.names)
    names[valve] = name
    return replace(command, names=tuple(names))


def _leapt(voltage: float, amount: float) -> float:
    """A voltage within the range, `amount` away on the side where there is room."""
    return voltage - amount if voltage > 0.0 else voltage + amount
