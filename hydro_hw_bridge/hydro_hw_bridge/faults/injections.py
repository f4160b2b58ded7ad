"""The families of injections, and the one that a seed gives."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial

from hydro_hw_bridge.faults import bus_injections as bus
from hydro_hw_bridge.faults import command_faults as commands
from hydro_hw_bridge.faults import machine_faults as machines
from hydro_hw_bridge.faults import other_injections as other
from hydro_hw_bridge.faults.bus_faults import LINK
from hydro_hw_bridge.faults.injection import Injection
from hydro_hw_bridge.protocol.codec import Codec

FIRST_CYCLE = (12, 45)
Draw = Callable[[random.Random, Codec, int], Injection]


#: Together they may give a frame of another cycle the alive counter of the present one, as one has
#: that is 16 cycles late.
_SIXTEEN = ({"late", "frozen_alive"}, {"late", "device_restart"})


def _several(source: random.Random, codec: Codec, at: int) -> Injection:
    """Two or three of the other families; a sensor that is stuck would outlast the others."""
    names = [name for name in FAMILIES if name not in ("several", "stuck")]
    while True:
        families = source.sample(names, source.choice((2, 3)))
        draws = [source.choice(FAMILIES[name]) for name in families]
        found = other.several([draw(source, codec, at) for draw in draws], source)
        if not any(pair <= found.kinds for pair in _SIXTEEN):
            return found


#: Families of injections, each of functions that take turns: of a family with kinds of its own
#: every kind, and every time that somebody may be gone, comes as often as the others.
FAMILIES: dict[str, tuple[Draw, ...]] = {
    "lost": (bus.lost,),
    "late": (bus.late,),
    "split": (bus.split,),
    "repeated": (bus.repeated,),
    "reordered": (bus.reordered,),
    "corrupt": (bus.corrupt,),
    "counters": (bus.counters,),
    "sensor": (bus.sensor,),
    "stuck": tuple(partial(bus.stuck, kind=kind) for kind in ("encoder", "pressure")),
    "babble": (bus.babble,),
    "foreign": (bus.foreign,),
    "intruder": (bus.intruder,),
    "link": tuple(partial(bus.link, kind=kind) for kind in LINK),
    "answers": (
        *(partial(bus.answers, kind=kind) for kind in bus.ANSWERS),
        bus.other_answers,
    ),
    "publisher": tuple(partial(other.publisher, kind=kind) for kind in commands.KINDS),
    "machine": (
        *(
            partial(other.machine, kind=kind)
            for kind in machines.KINDS
            if kind not in other.ABSENT
        ),
        *(
            partial(other.machine, kind=kind, cycles=cycles)
            for kind in other.ABSENT
            for cycles in other.GONE
        ),
    ),
    "several": (_several,),
}
#: In which they are drawn, those with many kinds twice. Their number has no divisor in common with
#: how often a run is in lockstep or of the real controller: every family meets both.
ORDER = (*FAMILIES, "answers", "publisher", "machine", "several", "sensor", "link")


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
    name, turn = family, seed
    if name is None:
        before, place = divmod(seed, len(ORDER))
        name = ORDER[place]
        turn = before * ORDER.count(name) + ORDER[:place].count(name)
    draws = FAMILIES[name]
    # Each round begins one further on: else a kind would be in lockstep always, or never.
    draw = draws[(turn + turn // len(draws)) % len(draws)]
    return draw(source, codec, source.randint(*FIRST_CYCLE))
