"""Injections beside the bus, each drawn: publishers, machine, bridge, clock; and several at once.

Parameters
----------
source : random.Random
    What is random in an injection is drawn from it.
codec : Codec
at : int
    First cycle of the fault.
kind : str, optional
    Of those that a function knows; by default it is drawn, too.
cycles : int, optional
    For how long it lasts, where somebody is gone; by default it is drawn, too.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import replace

from hydro_hw_bridge.faults import command_faults as commands
from hydro_hw_bridge.faults import machine_faults as machines
from hydro_hw_bridge.faults.bus_injections import AGAIN, NOTHING_HEARD, QUIET, TOO_OLD
from hydro_hw_bridge.faults.command_faults import CommandFault
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, STARVED, WATCHDOG, Injection
from hydro_hw_bridge.faults.machine_faults import MISSING, SUPPLY, MachineFault
from hydro_hw_bridge.faults.naming import Named
from hydro_hw_bridge.protocol.codec import Codec

#: What the gate says of a bad command.
SAID: Mapping[str, str] = {
    "nan": r"command is not finite \(nan\)",
    "infinite": r"command is not finite \(inf\)",
    "beyond": r"command of \S+ V \(rated 10 V\)",
    "unknown_valve": "command for valves .*swing_valve",
    "missing_valve": "command for valves .*expected each of",
    "valve_twice": "command for valves .*expected each of",
    "extra_voltage": r"with \d+ voltages",
    "leap": r"step of \S+ V in \d+ ms",
    "future": "stamp that is of no complete cycle",
    "off_grid": "stamp that is of no complete cycle",
    "second_controller": "is there a second controller",
}
#: For how many cycles bridge, controller or machine may be gone, and one that is dead.
GONE, DEAD = (3, 12, 60), 60
#: Kinds of faults that last for one of these times.
ABSENT = ("bridge_stopped", "controller_stopped", "device_silent")
#: Where harmless commands are counted.
HARMLESS_SHOWS = {"twice": "commands_repeated", "backwards": "commands_outdated"}
#: What a supply that lost its pressure may have left, Pa: less than the least that the gate takes,
#: whatever the transducer's noise and offset add.
_LEFT_PA = 1.8e6
#: More than the gate takes (4 V) and what a sound publisher's voltage moves in a cycle towards it
#: (9 V at 5 Hz, 0.57 V).
_LEAP_V = (4.6, 8.0)


def publisher(source: random.Random, codec: Codec, at: int, kind: str = "") -> Injection:
    """A publisher of bad, late, repeated or no commands."""
    kind = kind or source.choice(commands.KINDS)
    valve = source.randrange(len(codec.valve_names))
    amount = {
        "beyond": source.choice((-1, 1)) * source.choice((10.001, 11.0, 1e3, 1e300)),
        "leap": source.uniform(*_LEAP_V),
        "second_controller": source.uniform(0.01, 8.0),
        "late": float(source.randint(1, 30)),
    }.get(kind, 0.0)
    cycles = {"silent": source.choice((1, 5, 6, 30)), "late": 40}.get(kind, 1)
    fault = CommandFault(kind, at, cycles, amount, valve)
    if kind in commands.BAD:
        return Injection("publisher", fault, AT_ONCE, Named(("trips",), SAID[kind]))
    if kind in commands.HARMLESS:
        return Injection("publisher", fault, None, Named((HARMLESS_SHOWS[kind],)))
    if (cycles if kind == "silent" else amount) >= STARVED:
        return Injection("publisher", fault, AGE, Named(("trips",), TOO_OLD), AGAIN)
    silent = {
        "silent": "no commands for less than 10 ms",
        "late": "commands late, and still in time",
    }[kind]
    return Injection("publisher", fault, None, Named(silent=silent), AGAIN)


def machine(
    source: random.Random, codec: Codec, at: int, kind: str = "", cycles: int = 0
) -> Injection:
    """Permissives, bridge, controller, machine and clock."""
    kind = kind or source.choice(machines.KINDS)
    if kind in MISSING:
        left_pa = source.uniform(0.0, _LEFT_PA) if kind == SUPPLY else 0.0
        fault = MachineFault(kind, at, source.randint(1, 20), left_pa)
        return Injection("machine", fault, AT_ONCE, Named(("trips",), MISSING[kind]))
    if kind == "clock_step":
        amount = source.choice((-1, 1)) * source.choice((0.5, 60.0, 86_400.0))
        fault = MachineFault(kind, at, 1, amount)
        return Injection("machine", fault, None, Named(silent="a step of the ROS clock"))
    if kind == "device_restart":
        named = Named(("cycles_restarts",), "the device restarted")
        return Injection("machine", MachineFault(kind, at), AGE, named)
    if kind == "deactivated":
        named = Named(says="^inactive: reading$")
        return Injection("machine", MachineFault(kind, at, 5), AT_ONCE, named)
    if kind == "bridge_dead":
        cycles = DEAD
    return _absent(kind, cycles or source.choice(GONE), at)


def _absent(kind: str, cycles: int, at: int) -> Injection:
    """Bridge, controller or machine are gone for a while."""
    fault = MachineFault(kind, at, cycles)
    stops = AGE if cycles >= STARVED else None
    if stops and kind in ("bridge_dead", "bridge_stopped"):
        # Then only the amplifiers are left, until it goes on.
        stops = min(WATCHDOG, cycles + 1)
    if kind == "bridge_dead":
        named = Named(silent="a bridge that is dead")
        return Injection("machine", fault, stops, named)
    if kind == "bridge_stopped":
        brief = Named(silent="a bridge that stood still for less than 10 ms")
        named = Named(("trips",), TOO_OLD) if stops else brief
        return Injection("machine", fault, stops, named, AGAIN)
    if kind == "controller_stopped":
        brief = Named(silent="no commands for less than 10 ms")
        named = Named(("trips",), TOO_OLD) if stops else brief
        return Injection("machine", fault, stops, named, AGAIN)
    named = Named(("cycles_lost",), NOTHING_HEARD if stops else "")
    return Injection("machine", fault, stops, named, QUIET)


def several(parts: list[Injection], source: random.Random) -> Injection:
    """Faults at once, the others within 25 cycles of the first.

    Parameters
    ----------
    parts : list of Injection
        At least two.
    source : random.Random

    Returns
    -------
    Injection
        Without a limit of its own: what is promised whatever happens is looked for in every run.
    """
    first = parts[0].fault.first_cycle
    moved = [parts[0]]
    for part in parts[1:]:
        at = first + source.randrange(WATCHDOG)
        moved.append(replace(part, fault=replace(part.fault, first_cycle=at)))
    return Injection("several", parts[0].fault, None, Named(), parts=tuple(moved))
