"""When something comes and goes within a recording, more finely than it is looked for.

Instants are tried seconds apart. A load that is taken up a tenth of a second off leaves a spike in
every force, which a fit makes smaller by a smaller load.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_model.effects.catalogue import end_s, start_s
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Halvings of the time over which it comes about, and by which shares of it the best is moved and
#: stretched then.
_HALVINGS, _SHARES = 7, (0.25, 0.15, 0.1, 0.06, 0.03)
#: What is shorter than a few samples is an instant.
_LEAST_S = 0.01
#: How often the instants at which it comes and goes are settled, one beside the other.
_TURNS = 2
#: It goes again where that explains so much more: a share of what it explains by coming alone.
_GOES = 0.05

#: An effect with an edge at an instant, over a time.
_Move = Callable[[ActiveEffect, float, float], ActiveEffect]


def begins(one: ActiveEffect) -> bool:
    """Whether an effect begins at an instant of the recording."""
    return start_s(one) >= 0.0


def ends(one: ActiveEffect) -> bool:
    """Whether an effect goes again."""
    return math.isfinite(end_s(one))


def idle_edges(one: ActiveEffect) -> set[str]:
    """Names of an effect's instants and times that say no more than always, or never."""
    effect = one.effect
    come = () if begins(one) else (effect.start, effect.duration)
    gone = () if ends(one) else (effect.end, effect.end_duration)
    return {*come, *gone} - {""}


def beginning(one: ActiveEffect, at_s: float, over_s: float) -> ActiveEffect:
    """An effect that begins at another time.

    Parameters
    ----------
    one : ActiveEffect
    at_s : float
        The middle of the time over which it comes about.
    over_s : float
        That time; 0 for at once.
    """
    return _edged(one, (one.effect.start, one.effect.duration), (at_s, over_s))


def ending(one: ActiveEffect, at_s: float, over_s: float) -> ActiveEffect:
    """An effect that goes at another time.

    Parameters
    ----------
    one : ActiveEffect
    at_s : float
        The middle of the time over which it goes.
    over_s : float
        That time; 0 for at once.
    """
    return _edged(one, (one.effect.end, one.effect.end_duration), (at_s, over_s))


def lasting(one: ActiveEffect) -> ActiveEffect:
    """An effect that does not go again."""
    return replace(one, parameters=_with_defaults(one, (one.effect.end, one.effect.end_duration)))


def standing(one: ActiveEffect) -> ActiveEffect:
    """An effect that was there before the recording began, and does not go again."""
    since = _with_defaults(one, (one.effect.start, one.effect.duration))
    return lasting(replace(one, parameters=since))


@dataclass(frozen=True, slots=True)
class Sight:
    """How well an effect explains what is left, by when it comes and goes.

    Attributes
    ----------
    column : callable
        What such an effect adds, (N,).
    left : (N,) array
        Without it.
    sized : bool
        Its size is known; else it is what explains most.
    least : float
        In squares of what is left: what an end has to explain more, whatever its share.
    """

    column: Callable[[ActiveEffect], FloatArray]
    left: FloatArray
    sized: bool
    least: float = 0.0

    def gain(self, one: ActiveEffect) -> float:
        """Sum of squares that an effect explains."""
        column = self.column(one)
        return float(self._gains(column @ self.left, column @ column))

    def first(self, one: ActiveEffect, instants_s: Sequence[float]) -> ActiveEffect:
        """An effect that stays from before the recording, or from one of some instants on."""
        one, spacing_s = lasting(one), spacing(instants_s)
        tried = [standing(one), *(beginning(one, at, spacing_s) for at in instants_s)]
        return max(tried, key=self.gain)

    def placed(self, one: ActiveEffect, spacing_s: float, ends_s: Sequence[float]) -> ActiveEffect:
        """An effect that comes when it tells most, and goes again if that tells more.

        Parameters
        ----------
        one : ActiveEffect
            At the best of the instants that were tried, from which on it stays.
        spacing_s : float
            Between them.
        ends_s : sequence of float
            At two of which it may come and go; it may have come before the recording.
        """
        stays = one
        if begins(one):
            stays = self._settled(one, beginning, start_s(one), spacing_s)
        if not (one.effect.end and len(ends_s)):
            return stays
        passes, wide_s = self._passing(one, ends_s), spacing(ends_s)
        for _ in range(_TURNS):
            if begins(passes):
                passes = self._settled(passes, beginning, start_s(passes), wide_s)
            passes = self._settled(passes, ending, end_s(passes), wide_s)
        alone = self.gain(stays)
        return passes if self.gain(passes) > alone + max(_GOES * alone, self.least) else stays

    def _settled(
        self, one: ActiveEffect, moved: _Move, at_s: float, near_s: float
    ) -> ActiveEffect:
        """An effect with one edge where it explains most, less than `near_s` from where it is."""
        return moved(one, *settled(at_s, near_s, lambda *at: -self.gain(moved(one, *at))))

    def _passing(self, one: ActiveEffect, ends_s: Sequence[float]) -> ActiveEffect:
        """The best of those that come before or at one instant and go at a later one."""
        wide_s, lasts = spacing(ends_s), lasting(one)
        came = [standing(one), *(beginning(lasts, at, wide_s) for at in ends_s)]
        columns = np.stack([self.column(of) for of in came], axis=1)
        along, products = columns.T @ self.left, columns.T @ columns
        squares = np.diag(products)
        both = squares[:, None] + squares[None, :] - 2.0 * products
        gains = self._gains(along[:, None] - along[None, :], both)
        later = np.triu(np.ones_like(gains, dtype=bool), 1)
        first, last = np.unravel_index(np.argmax(np.where(later, gains, -np.inf)), gains.shape)
        return ending(came[int(first)], float(ends_s[int(last) - 1]), wide_s)

    def _gains(self, along: FloatArray | float, squares: FloatArray | float) -> FloatArray:
        if self.sized:
            return np.asarray(2.0 * np.asarray(along) - squares)
        return np.asarray(along) ** 2 / np.maximum(squares, 1e-300)


def settled(
    at_s: float, spacing_s: float, left: Callable[[float, float], float]
) -> tuple[float, float]:
    """The instant, and the time over which something comes about, that leave least.

    Over ever shorter times, each about the earlier, the middle or the later half of the one
    before; then in small steps around the best.

    Parameters
    ----------
    at_s : float
    spacing_s : float
        Between instants that were tried: it is less than that from its own.
    left : callable
        What is left where it comes about at an instant, over a time; as a sum of squares.

    Returns
    -------
    at_s, over_s : float
    """
    tried: dict[tuple[float, float], float] = {}

    def best(times: list[tuple[float, float]]) -> tuple[float, float]:
        for at in times:
            if at not in tried:
                tried[at] = left(*at)
        return min(times, key=lambda at: tried[at])

    now = best([(at_s, spacing_s)])
    for _ in range(_HALVINGS):
        half = 0.5 * now[1]
        now = best([(now[0] + shift * half, half) for shift in (-1.0, -0.5, 0.0, 0.5, 1.0)])
    best([(now[0], 0.0), (at_s, 0.0)])
    for share in _SHARES:
        at_s, over_s = min(tried, key=lambda at: tried[at])
        step = share * max(over_s, _LEAST_S)
        shifted = [(at_s + shift, over_s) for shift in (-step, step)]
        best(shifted + [(at_s, factor * over_s) for factor in (1.0 - share, 1.0 + share)])
    at_s, over_s = min(tried, key=lambda at: tried[at])
    return at_s, over_s if over_s >= _LEAST_S else 0.0


def spacing(instants_s: Sequence[float]) -> float:
    """What lies between two instants, in s, without a pause; 0 where there is a single one."""
    return float(np.diff(instants_s).min()) if len(instants_s) > 1 else 0.0


def _edged(one: ActiveEffect, names: tuple[str, str], values: tuple[float, float]) -> ActiveEffect:
    """An effect with one edge elsewhere: its instant and the time over which it comes about."""
    parameters = one.parameters.copy()
    for name, value in zip(names, values, strict=True):
        if name:
            parameters[_at(one, name)] = value
    return replace(one, parameters=parameters)


def _with_defaults(one: ActiveEffect, names: Sequence[str]) -> FloatArray:
    parameters = one.parameters.copy()
    for name in (n for n in names if n):
        spec = one.effect.parameters[_at(one, name)]
        parameters[_at(one, name)] = spec.typical if spec.default is None else spec.default
    return parameters


def _at(one: ActiveEffect, name: str) -> int:
    return [p.name for p in one.effect.parameters].index(name)
