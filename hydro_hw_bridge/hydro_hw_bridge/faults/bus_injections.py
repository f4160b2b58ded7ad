"""Injections on the bus, each drawn.

Parameters
----------
source : random.Random
    What is random in an injection is drawn from it.
codec : Codec
at : int
    First cycle of the fault.
kind : str, optional
    Of those that a function knows; by default it is drawn, too.
"""

from __future__ import annotations

import random
from dataclasses import replace

from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, LINK, BusFault
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, STARVED, STUCK, WATCHDOG, Injection
from hydro_hw_bridge.faults.naming import Named
from hydro_hw_bridge.protocol.codec import Codec

#: A frame that comes exactly so many cycles late, or a multiple, and before the one that belongs
#: there, has the alive counter of the present cycle: nothing in it tells it apart. Frames of one
#: identifier do not overtake each other on CAN, so no injection makes them.
ALIVE_SPAN = 16
#: A pressure that is the same for so many cycles is named.
STILL = 1000
TOO_OLD, NO_WHOLE = "no command for", "no whole cycle for"
NOTHING_HEARD = "nothing from the device for 10 ms"
NO_SYNC = "no sync frame from the device for 10 ms"
#: Without whole cycles there are no commands: which of the two is older by a cycle is the
#: controller's doing.
STARVING = f"{NO_WHOLE}|{TOO_OLD}"
#: What may happen to valve frames on their way.
ANSWERS = ("lost", "late", "repeated", "bit_flip", "truncated", "frozen", "babble")
#: Cycles until the bridge has answered valve frames that it heard: those of the cycle after.
HEARD = 2
EITHER = f"{NOTHING_HEARD}|{NO_SYNC}|{STARVING}"
UNSENT, STANDS = "valve frames cannot be sent", "sample counter stood still"
TWO_FRAMES = "two different frames"
AGAIN = Named(("cycles_repeated",))
#: In lockstep nothing arrives: the machine's time stands still meanwhile.
QUIET = Named(silent="a machine in lockstep that is silent")


def lost(source: random.Random, codec: Codec, at: int) -> Injection:
    """One of the machine's frames does not arrive."""
    cycles = source.choice((1, 2, 4, 7, 12, 40))
    frame = source.choice(codec.device_ids)
    words = EITHER if frame == codec.device_ids[0] else STARVING
    limit, says = (AGE, words) if cycles >= STARVED else (None, "")
    shows = ("cycles_lost", "cycles_incomplete", "cycles_out_of_order")
    fault = BusFault("lost", at, cycles, DEVICE, (frame,))
    # In lockstep the cycle is sent again until it is answered: nothing trips.
    again = Named((*shows, *AGAIN.shows, "cycles_duplicates"))
    border = words if cycles == STARVED - 1 else ""
    return Injection("bus", fault, limit, Named(shows, says), again, may_trip_late=border)


def late(source: random.Random, codec: Codec, at: int) -> Injection:
    """The machine's frames arrive cycles later."""
    amount = source.randrange(1, ALIVE_SPAN)
    frames = () if source.random() < 0.3 else (source.choice(codec.device_ids),)
    cycles = source.randint(1, 12)
    fault = BusFault("late", at, cycles, DEVICE, frames, amount=amount)
    shows = ("cycles_out_of_order", "cycles_lost", "cycles_incomplete")
    with_sync = not frames or frames[0] == codec.device_ids[0]
    words = EITHER if with_sync else STARVING
    without = _without_samples(fault, codec)
    named, limit, border = Named(shows), None, ""
    if without >= STARVED:
        named, limit = Named(shows, words), _late_limit(fault, codec)
    elif without == STARVED - 1:
        border = words
    again = Named((*shows, *AGAIN.shows))
    return Injection("bus", fault, limit, named, again, may_trip_late=border)


def _without_samples(fault: BusFault, codec: Codec) -> int:
    """For how many cycles, by the sample counter, late frames leave the gate without a sample.

    A sync frame of the past ends the cycle in which it comes. So sync frames that are late spoil
    the cycles from which they are missing, and as many in which they come: one gap, where the
    latter follow at once.
    """
    in_a_row = fault.amount <= fault.cycles
    if not fault.frames:
        # Cycles that are late as a whole are whole: what was answered before the gap is as late.
        return 2 * fault.amount if in_a_row else fault.cycles
    if fault.frames[0] == codec.device_ids[0] and in_a_row:
        return fault.cycles + fault.amount
    return fault.cycles


def _late_limit(fault: BusFault, codec: Codec) -> int:
    """Within how many cycles late frames that starve the gate end driving.

    Where sync frames come, and are late, the time that the bridge counts is behind by as much;
    where none comes, it is the silence that ends driving.
    """
    if fault.amount > min(STARVED, fault.cycles):
        return AGE
    if not fault.frames:
        # It drives on, too late by as much, until the cycles that are in time come in between.
        return fault.cycles + AGE - fault.amount
    return AGE + fault.amount if fault.frames[0] == codec.device_ids[0] else AGE


def split(source: random.Random, codec: Codec, at: int) -> Injection:
    """The rest of a cycle's frames arrives in the next one."""
    stay = source.randint(1, len(codec.device_ids) - 1)
    cycles = source.randint(1, 10)
    fault = BusFault("split", at, cycles, amount=stay)
    starved = cycles >= STARVED
    named = Named(("cycles_incomplete",), STARVING if starved else "")
    again = Named((*AGAIN.shows, "cycles_out_of_order", "cycles_duplicates"))
    border = STARVING if cycles == STARVED - 1 else ""
    limit = AGE if starved else None
    return Injection("bus", fault, limit, named, again, may_trip_late=border)


def repeated(source: random.Random, codec: Codec, at: int) -> Injection:
    """One of the machine's frames arrives several times."""
    frame = source.choice(codec.device_ids)
    fault = BusFault("repeated", at, 6, DEVICE, (frame,), amount=source.randint(1, 5))
    named = Named(("cycles_duplicates", "cycles_repeated", "cycles_out_of_order"))
    if frame == codec.device_ids[0]:
        named = Named(("cycles_begun_again",))
    return Injection("bus", fault, None, named)


def reordered(source: random.Random, codec: Codec, at: int) -> Injection:
    """The machine's frames overtake each other."""
    fault = BusFault("reordered", at, 12, seed=source.randrange(1 << 30))
    shows = ("cycles_out_of_order", "cycles_incomplete")
    again = Named((*shows, *AGAIN.shows, "cycles_duplicates"))
    # A quarter of its cycles is whole: that none of five is, is left to chance.
    return Injection("bus", fault, None, Named(shows), again, may_trip=STARVING)


def corrupt(source: random.Random, codec: Codec, at: int) -> Injection:
    """A bit of the machine's frames is another, or their end is missing."""
    frames = () if source.random() < 0.3 else (source.choice(codec.device_ids),)
    if source.random() < 0.7:
        fault = BusFault("bit_flip", at, 4, DEVICE, frames, amount=source.randrange(64))
    else:
        fault = BusFault("truncated", at, 4, DEVICE, frames, amount=source.randrange(8))
    return Injection("bus", fault, None, Named(("cycles_corrupt",)), may_trip_late=EITHER)


def counters(source: random.Random, codec: Codec, at: int) -> Injection:
    """The machine's counters stand still or run wild.

    Still stands all of a cycle, its sync frame alone, or one frame's alive counter.
    """
    cycles = source.choice((3, 8, 40))
    # In the first of its cycles the counter is still the right one.
    limit = AGE + 1 if cycles > AGE + 1 else None
    kind = source.choice(("frozen", "frozen sync", "wild", "frozen_alive"))
    if kind == "frozen_alive":
        frame = (source.choice(codec.device_ids[1:]),)
        shows = ("cycles_out_of_order", "cycles_corrupt")
        fault = BusFault("frozen_alive", at, cycles, DEVICE, frame)
        named = Named(shows, STARVING if limit else "")
        return Injection("bus", fault, limit, named, Named(shows))
    if kind == "frozen":
        named = Named(("cycles_repeated", "cycles_duplicates"), STANDS if limit else "")
        return Injection("bus", BusFault("frozen", at, cycles), limit, named, AGAIN)
    if kind == "wild":  # from the first of its cycles on
        limit = AGE if cycles > AGE else None
    fault = BusFault(kind.partition(" ")[0], at, cycles, DEVICE, codec.device_ids[:1])
    shown = Named(("cycles_begun_again", "cycles_out_of_order", "cycles_incomplete"))
    return Injection("bus", fault, limit, replace(shown, says=STANDS if limit else ""), shown)


def sensor(source: random.Random, codec: Codec, at: int) -> Injection:
    """A position jumps, or a sensor reads the end of its range."""
    joints, pressures = codec.mapping.joints, codec.mapping.pressures
    if source.random() < 0.5:
        name = source.choice(sorted(joints))
        counts = source.choice((-1, 1)) * source.randint(4000, 1 << 20)
        fault = BusFault("jump", at, 3, DEVICE, (), joints[name].signal, counts)
        named = Named(("readings_jumps",), f"{name}: position jumped")
        return Injection("bus", fault, AT_ONCE, named)
    channels = {**joints, **pressures}
    name = source.choice(sorted(channels))
    fault = BusFault("extreme", at, 3, DEVICE, (), channels[name].signal, source.randrange(2))
    named = (
        Named(("readings_jumps",), f"{name}: position jumped")
        if name in joints
        else Named(("readings_out_of_range",), f"pressure {name} cannot be")
    )
    return Injection("bus", fault, AT_ONCE, named)


def stuck(source: random.Random, codec: Codec, at: int, kind: str = "") -> Injection:
    """A sensor gives the same value on and on, while the machine moves."""
    mapping = codec.mapping
    kind = kind or source.choice(("encoder", "pressure"))
    long = source.random() < 0.7
    channels = mapping.joints if kind == "encoder" else mapping.pressures
    name = source.choice(sorted(channels))
    limit = None
    if kind == "encoder":
        cycles = STUCK + 20 if long else source.randint(20, 200)
        limit = STUCK if long else None
        named = Named(("readings_stuck",), f"{name}: encoder stuck")
        brief = "an encoder stuck for less than 0.5 s"
    else:
        cycles = STILL + 20 if long else source.randint(20, 200)
        named = Named(("readings_still",), f"pressure {name} without any noise")
        brief = "a pressure stuck for less than 2 s"
    fault = BusFault("stuck", at, cycles, DEVICE, (), channels[name].signal)
    return Injection(
        "bus",
        fault,
        limit,
        named if long else Named(silent=brief),
        sensor=kind,
        # Where the joint has moved meanwhile, its encoder jumps when it goes on.
        may_trip=f"{name}: position jumped" if kind == "encoder" else "",
    )


def babble(source: random.Random, codec: Codec, at: int) -> Injection:
    """Noise under the machine's identifiers, beside its frames."""
    seed = source.randrange(1 << 30)
    frames = () if source.random() < 0.5 else (source.choice(codec.device_ids),)
    fault = BusFault("babble", at, 40, DEVICE, frames, amount=source.randint(5, 15), seed=seed)
    # Noise that passes its check by chance is a frame too many of its cycle.
    return Injection("bus", fault, None, Named(("cycles_corrupt",)), may_trip=TWO_FRAMES)


def foreign(source: random.Random, codec: Codec, at: int) -> Injection:
    """Somebody who knows counters and checks sends under one of the machine's identifiers."""
    seed = source.randrange(1 << 30)
    frame = (source.choice(codec.device_ids),)
    fault = BusFault("foreign", at, 10, DEVICE, frame, amount=source.randint(1, 10), seed=seed)
    shows = ("duplicates", "out_of_order", "lost", "repeated", "restarts", "corrupt")
    named = Named((*(f"cycles_{name}" for name in shows), "trips"))
    return Injection("bus", fault, None, named)


def intruder(source: random.Random, codec: Codec, at: int) -> Injection:
    """A second bridge, or a machine on the other clock."""
    kind = source.choice(("second_bridge", "clock_bit"))
    frames = (codec.device_ids[0],) if kind == "clock_bit" else ()
    fault = BusFault(kind, at, 3, DEVICE, frames, seed=source.randrange(1 << 30))
    says = "second bridge" if kind == "second_bridge" else "the device's clock is"
    return Injection("bus", fault, AT_ONCE, Named(("trips",), says))


def link(source: random.Random, codec: Codec, at: int, kind: str = "") -> Injection:
    """The bridge's own end of the bus: bus-off, a full queue, an interface that is gone."""
    kind = kind or source.choice(LINK)
    cycles = source.choice((2, 10, 60))
    limit = WATCHDOG if cycles > WATCHDOG else None
    fault = BusFault(kind, at, cycles)
    if kind == "bus_off":
        named = Named(("bus_error_frames",), "bus-off")
        return Injection("bus", fault, limit, named)
    if kind == "queue_full":
        named = Named(("bus_dropped",), UNSENT if cycles > AGE else "")
        # In lockstep a cycle is answered as often as it is told.
        again = Named(("bus_dropped",))
        return Injection("bus", fault, limit, named, again, may_trip=UNSENT)
    shows = ("bus_send_errors", "cycles_lost", "trips")
    named = Named(shows, EITHER if cycles > AGE else "")
    return Injection("bus", fault, limit, named, QUIET)


def answers(source: random.Random, codec: Codec, at: int, kind: str = "") -> Injection:
    """What the bridge sends is lost, late, repeated, broken, the same again, or beside noise."""
    kind = kind or source.choice(ANSWERS)
    cycles, amount = source.choice((1, 4, 20, 40)), source.randint(1, 7)
    if kind == "frozen":
        # Of 20 that are the same again the amplifiers count six: nobody knows what they hold. And
        # the first of them is itself.
        cycles = source.choice((4, 40))
    if kind == "late":
        cycles, amount = source.choice((4, 20, 40)), source.randint(1, 30)
    if kind == "bit_flip":
        amount = source.randrange(64)
    gone = kind in ("lost", "bit_flip", "truncated") or (kind == "late" and amount > STARVED)
    limit = WATCHDOG if gone and cycles > WATCHDOG else None
    in_time = not gone and kind == "late"
    if kind == "frozen":  # the first of them is in time for as long as a command may be old
        limit = AGE + WATCHDOG if cycles > AGE + WATCHDOG else None
        in_time = cycles <= STARVED
    seed = source.randrange(1 << 30)
    fault = BusFault(kind, at, cycles, BRIDGE, amount=amount, seed=seed)
    if limit:
        named = Named(("trips",), "watchdog shut them down")
    elif in_time:
        named = Named(silent="valve frames late, and still in time")
    else:
        # What the amplifiers say that they heard tells it.
        shows = {"lost": "lost", "repeated": "surplus"}.get(kind, "refused")
        named = Named((f"valve_frames_{shows}",))
    # There the machine asks again for what it did not get.
    again = AGAIN if gone or kind in ("late", "frozen") else None
    return Injection("bus", fault, limit, named, again)


def other_answers(source: random.Random, codec: Codec, at: int) -> Injection:
    """Somebody who knows counters and checks sends valve frames, which the bridge hears, too."""
    seed, amount = source.randrange(1 << 30), source.randint(1, 10)
    fault = BusFault("foreign", at, 10, BRIDGE, amount=amount, seed=seed)
    return Injection("bus", fault, HEARD, Named(("trips",), "valve frames of another sender"))
