"""The families of injections, and the one that a seed gives."""

from __future__ import annotations

import random
from collections.abc import Callable

from hydro_hw_bridge.codec import Codec
from hydro_hw_bridge.faults import bus_injections as bus
from hydro_hw_bridge.faults import other_injections as other
from hydro_hw_bridge.faults.injection import Injection

FIRST_CYCLE = (12, 45)
Draw = Callable[[random.Random, Codec, int], Injection]


#: Together they may give a frame of another cycle the alive counter of the present one, as one has
#: that is 16 cycles late.
_SIXTEEN = ({"late", "frozen_alive"}, {"late", "device_restart"})


def _several(source: random.Random, codec: Codec, at: int) -> Injection:
    """Two or three of the other families; a sensor that is stuck would outlast the others."""
    families = [draw for draw in FAMILIES.values() if draw not in (_several, bus.stuck)]
    while True:
        draws = source.sample(families, source.choice((2, 3)))
        found = other.several([draw(source, codec, at) for draw in draws], source)
        if not any(pair <= found.kinds for pair in _SIXTEEN):
            return found


#: Families of injections, drawn in turn. Their number has no divisor in common with how often a
#: run is in lockstep or of the real controller: every family meets both.
FAMILIES: dict[str, Draw] = {
    "lost": bus.lost,
    "late": bus.late,
    "split": bus.split,
    "repeated": bus.repeated,
    "reordered": bus.reordered,
    "corrupt": bus.corrupt,
    "counters": bus.counters,
    "sensor": bus.sensor,
    "stuck": bus.stuck,
    "babble": bus.babble,
    "foreign": bus.foreign,
    "intruder": bus.intruder,
    "link": bus.link,
    "answers": bus.answers,
    "publisher": other.publisher,
    "machine": other.machine,
    "several": _several,
    "publisher_again": other.publisher,
    "machine_again": other.machine,
    "several_again": _several,
    "sensor_again": bus.sensor,
    "link_again": bus.link,
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
