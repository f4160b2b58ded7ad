"""Injections: one fault at a random moment, what is promised of it, and where it must show."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from hydro_hw_bridge.codec import Codec
from hydro_hw_bridge.faults import command_faults as commands
from hydro_hw_bridge.faults import machine_faults as machines
from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, LINK, BusFault
from hydro_hw_bridge.faults.command_faults import CommandFault
from hydro_hw_bridge.faults.machine_faults import PERMISSIVES, MachineFault

#: Cycles of 2 ms: at once (the answer of the same cycle), a command's age, the watchdog.
AT_ONCE, AGE, WATCHDOG = 1, 6, 25
FIRST_CYCLE = (12, 45)
#: A frame that comes exactly so many cycles late, or a multiple, and before the one that belongs
#: there, has the alive counter of the present cycle: nothing in it tells it apart. Frames of one
#: identifier do not overtake each other on CAN, so no injection makes them.
ALIVE_SPAN = 16


@dataclass(frozen=True, slots=True)
class Injection:
    """One fault and what is promised of it.

    Attributes
    ----------
    group : {"bus", "publisher", "machine"}
    fault : BusFault, CommandFault or MachineFault
    limit_cycles : int or None
        Cycles from the first one of the fault to 0 V and enable off at the valves; None where
        driving on is right.
    shows : tuple of str
        Counters of which one at least must have grown; `trip` for a latched reason.
    """

    group: str
    fault: BusFault | CommandFault | MachineFault
    limit_cycles: int | None
    shows: tuple[str, ...]

    @property
    def kind(self) -> str:
        """Kind of the fault, with the direction of frames."""
        if isinstance(self.fault, BusFault) and self.fault.kind not in LINK:
            return f"{self.fault.kind} ({self.fault.direction})"
        return self.fault.kind


Draw = Callable[[random.Random, Codec, int], Injection]


def _lost(source: random.Random, codec: Codec, at: int) -> Injection:
    cycles = source.choice((1, 2, 4, 7, 12, 40))
    frame = source.choice(codec.device_ids)
    sync = frame == codec.device_ids[0]
    limit = None
    if cycles >= (WATCHDOG + 5 if sync else AGE + 1):
        limit = WATCHDOG if sync else AGE
    shows = ("cycles_lost", "cycles_incomplete", "cycles_out_of_order")
    return Injection("bus", BusFault("lost", at, cycles, DEVICE, (frame,)), limit, shows)


def _late(source: random.Random, codec: Codec, at: int) -> Injection:
    amount = source.randrange(1, ALIVE_SPAN)
    frames = () if source.random() < 0.3 else (source.choice(codec.device_ids),)
    fault = BusFault("late", at, source.randint(1, 12), DEVICE, frames, amount=amount)
    shows = ("cycles_out_of_order", "cycles_lost", "cycles_incomplete")
    return Injection("bus", fault, None, shows)


def _split(source: random.Random, codec: Codec, at: int) -> Injection:
    stay = source.randint(1, len(codec.device_ids) - 1)
    fault = BusFault("split", at, source.randint(1, 10), amount=stay)
    return Injection("bus", fault, None, ("cycles_incomplete",))


def _repeated(source: random.Random, codec: Codec, at: int) -> Injection:
    frame = source.choice(codec.device_ids)
    fault = BusFault("repeated", at, 6, DEVICE, (frame,), amount=source.randint(1, 5))
    shows: tuple[str, ...] = ("cycles_duplicates", "cycles_repeated", "cycles_out_of_order")
    if frame == codec.device_ids[0]:
        shows = ()  # the same sync frame again, before anything else, opens the same cycle
    return Injection("bus", fault, None, shows)


def _reordered(source: random.Random, codec: Codec, at: int) -> Injection:
    fault = BusFault("reordered", at, 12, seed=source.randrange(1 << 30))
    return Injection("bus", fault, None, ("cycles_out_of_order", "cycles_incomplete"))


def _corrupt(source: random.Random, codec: Codec, at: int) -> Injection:
    frames = () if source.random() < 0.3 else (source.choice(codec.device_ids),)
    if source.random() < 0.7:
        fault = BusFault("bit_flip", at, 4, DEVICE, frames, amount=source.randrange(64))
    else:
        fault = BusFault("truncated", at, 4, DEVICE, frames, amount=source.randrange(8))
    return Injection("bus", fault, None, ("cycles_corrupt",))


def _counters(source: random.Random, codec: Codec, at: int) -> Injection:
    cycles = source.choice((3, 8, 40))
    # In the first of its cycles the counter is still the right one.
    limit = AGE + 1 if cycles > AGE + 1 else None
    if source.random() < 0.5:
        fault = BusFault("frozen", at, cycles)
        return Injection("bus", fault, limit, ("cycles_repeated", "cycles_duplicates"))
    frame = (source.choice(codec.device_ids[1:]),)
    shows = ("cycles_out_of_order", "cycles_corrupt")
    return Injection("bus", BusFault("frozen_alive", at, cycles, DEVICE, frame), limit, shows)


def _sensor(source: random.Random, codec: Codec, at: int) -> Injection:
    mapping = codec.mapping
    joints = [channel.signal for channel in mapping.joints.values()]
    pressures = [channel.signal for channel in mapping.pressures.values()]
    if source.random() < 0.5:
        signal = source.choice(joints)
        counts = source.choice((-1, 1)) * source.randint(4000, 1 << 20)
        fault = BusFault("jump", at, 3, DEVICE, (), signal, counts)
        return Injection("bus", fault, AT_ONCE, ("readings_jumps",))
    signal = source.choice(joints + pressures)
    fault = BusFault("extreme", at, 3, DEVICE, (), signal, source.randrange(2))
    shows = ("readings_jumps",) if signal in joints else ("readings_out_of_range",)
    return Injection("bus", fault, AT_ONCE, shows)


def _babble(source: random.Random, codec: Codec, at: int) -> Injection:
    seed = source.randrange(1 << 30)
    fault = BusFault("babble", at, 10, amount=source.randint(3, 30), seed=seed)
    return Injection("bus", fault, None, ("cycles_corrupt",))


def _intruder(source: random.Random, codec: Codec, at: int) -> Injection:
    kind = source.choice(("second_bridge", "clock_bit"))
    frames = (codec.device_ids[0],) if kind == "clock_bit" else ()
    fault = BusFault(kind, at, 3, DEVICE, frames, seed=source.randrange(1 << 30))
    return Injection("bus", fault, AT_ONCE, ("trip",))


def _link(source: random.Random, codec: Codec, at: int) -> Injection:
    kind = source.choice(LINK)
    cycles = source.choice((2, 10, 60))
    shows = ("bus_send_errors", "bus_dropped", "bus_error_frames", "cycles_lost", "trip")
    limit = WATCHDOG if cycles > WATCHDOG else None
    return Injection("bus", BusFault(kind, at, cycles), limit, shows)


def _answers(source: random.Random, codec: Codec, at: int) -> Injection:
    kind = source.choice(("lost", "late", "repeated", "bit_flip", "truncated", "babble"))
    cycles, amount = source.choice((1, 4, 40)), source.randint(1, 7)
    if kind == "late":
        cycles, amount = source.choice((4, 40)), source.randint(1, 30)
    if kind == "bit_flip":
        amount = source.randrange(64)
    gone = kind in ("lost", "bit_flip", "truncated") or (kind == "late" and amount > AGE)
    limit = WATCHDOG if gone and cycles > WATCHDOG else None
    seed = source.randrange(1 << 30)
    fault = BusFault(kind, at, cycles, BRIDGE, amount=amount, seed=seed)
    shows = ("device_missed", "device_corrupt", "device_stale")
    return Injection("bus", fault, limit, () if kind in ("repeated", "babble") else shows)


def _publisher(source: random.Random, codec: Codec, at: int) -> Injection:
    kind = source.choice(commands.KINDS)
    valve = source.randrange(len(codec.valve_names))
    amount = {
        "beyond": source.choice((-1, 1)) * source.choice((10.001, 11.0, 1e3, 1e300)),
        "leap": source.uniform(4.1, 8.0),
        "second_controller": source.uniform(0.01, 8.0),
        "late": float(source.randint(1, 30)),
    }.get(kind, 0.0)
    cycles = {"silent": source.choice((1, 5, 6, 30)), "late": 40}.get(kind, 1)
    fault = CommandFault(kind, at, cycles, amount, valve)
    if kind in commands.BAD:
        return Injection("publisher", fault, AT_ONCE, ("trip",))
    if kind in commands.HARMLESS:
        return Injection("publisher", fault, None, ("commands_repeated", "commands_outdated"))
    if (kind == "silent" and cycles >= AGE) or (kind == "late" and amount >= AGE):
        return Injection("publisher", fault, AGE, ("trip",))
    return Injection("publisher", fault, None, ())


def _machine(source: random.Random, codec: Codec, at: int) -> Injection:
    kind = source.choice(machines.KINDS)
    shows: tuple[str, ...]
    if kind in PERMISSIVES:
        fault = MachineFault(kind, at, source.randint(1, 20))
        return Injection("machine", fault, AT_ONCE, ("trip",))
    if kind in ("bridge_dead", "bridge_stopped"):
        cycles = 60 if kind == "bridge_dead" else source.choice((3, 12, 60))
        limit = WATCHDOG if cycles > WATCHDOG else None
        shows = ("device_missed",)
        return Injection("machine", MachineFault(kind, at, cycles), limit, shows)
    if kind in ("controller_stopped", "device_silent"):
        cycles = source.choice((3, 12, 60))
        limit = {"controller_stopped": AGE, "device_silent": WATCHDOG}[kind]
        stops = cycles > limit
        shows = ("trip",) if stops else ()
        fault = MachineFault(kind, at, cycles)
        return Injection("machine", fault, limit if stops else None, shows)
    if kind == "clock_step":
        amount = source.choice((-1, 1)) * source.choice((0.5, 60.0, 86_400.0))
        return Injection("machine", MachineFault(kind, at, 1, amount), None, ())
    if kind == "device_restart":
        return Injection("machine", MachineFault(kind, at), AGE, ("cycles_restarts",))
    return Injection("machine", MachineFault("deactivated", at, 5), AT_ONCE, ())


#: Families of injections, drawn in turn.
FAMILIES: dict[str, Draw] = {
    "lost": _lost,
    "late": _late,
    "split": _split,
    "repeated": _repeated,
    "reordered": _reordered,
    "corrupt": _corrupt,
    "counters": _counters,
    "sensor": _sensor,
    "babble": _babble,
    "intruder": _intruder,
    "link": _link,
    "answers": _answers,
    "publisher": _publisher,
    "machine": _machine,
    "publisher_again": _publisher,
    "machine_again": _machine,
}


def drawn(seed: int, codec: Codec, family: str | None = None) -> Injection:
    """The injection of a seed.

    Parameters
    ----------
    seed : int
    codec : Codec
    family : str, optional
        By default the families take turns.

    Returns
    -------
    Injection
    """
    source = random.Random(seed)
    name = family or tuple(FAMILIES)[seed % len(FAMILIES)]
    return FAMILIES[name](source, codec, source.randint(*FIRST_CYCLE))
