"""When something begins within a recording, and over how long, more finely than it is looked for.

Instants are tried seconds apart. A load that is taken up a tenth of a second off leaves a spike in
every force, which a fit makes smaller by a smaller load.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from hydro_model.effects.targets import ActiveEffect

#: Halvings of the time over which it comes about, and by which shares of it the best is moved and
#: stretched then.
_HALVINGS, _SHARES = 7, (0.25, 0.15, 0.1, 0.06, 0.03)
#: What is shorter than a few samples is an instant.
_LEAST_S = 0.01


def begins(one: ActiveEffect) -> bool:
    """Whether an effect begins at an instant of the recording."""
    return bool(one.effect.start) and one.parameters[_at(one, one.effect.start)] >= 0.0


def beginning(one: ActiveEffect, start_s: float, duration_s: float) -> ActiveEffect:
    """An effect that begins at another time."""
    values = one.parameters.copy()
    values[_at(one, one.effect.start)] = start_s
    if one.effect.duration:
        values[_at(one, one.effect.duration)] = duration_s
    return replace(one, parameters=values)


def settled(
    one: ActiveEffect, spacing_s: float, left: Callable[[ActiveEffect], float]
) -> ActiveEffect:
    """An effect at the time at which it leaves least, from one of the instants that were tried on.

    Over ever shorter times, each about the earlier, the middle or the later half of the one
    before; then in small steps around the best.

    Parameters
    ----------
    one : ActiveEffect
    spacing_s : float
        Between instants that were tried: it begins less than that from its own.
    left : callable
        What such an effect leaves, as a sum of squares.
    """
    start_s = float(one.parameters[_at(one, one.effect.start)])
    tried: dict[tuple[float, float], float] = {}

    def best(times: list[tuple[float, float]]) -> tuple[float, float]:
        for at in times:
            if at not in tried:
                tried[at] = left(beginning(one, *at))
        return min(times, key=lambda at: tried[at])

    now = best([(start_s, spacing_s)])
    for _ in range(_HALVINGS):
        half = 0.5 * now[1]
        now = best([(now[0] + shift * half, half) for shift in (-1.0, -0.5, 0.0, 0.5, 1.0)])
    best([(now[0], 0.0), (start_s, 0.0)])
    for share in _SHARES:
        start_s, over_s = min(tried, key=lambda at: tried[at])
        step = share * max(over_s, _LEAST_S)
        shifted = [(start_s + shift, over_s) for shift in (-step, step)]
        best(shifted + [(start_s, factor * over_s) for factor in (1.0 - share, 1.0 + share)])
    start_s, over_s = min(tried, key=lambda at: tried[at])
    return beginning(one, start_s, over_s if over_s >= _LEAST_S else 0.0)


def _at(one: ActiveEffect, name: str) -> int:
    return [p.name for p in one.effect.parameters].index(name)
