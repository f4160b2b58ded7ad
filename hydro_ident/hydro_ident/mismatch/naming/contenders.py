"""Which of the contenders for a name are fitted, and which of them leads."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.trials.scoring import Score
from hydro_model.effects.targets import ActiveEffect

#: Share of the best gain that earns a contender a thorough fit, and how many get it.
CLOSE_SHARE, _THOROUGH = 0.7, 3
#: Share of the held-out gain of what cannot be the cause from which what can be is as good a name.
_AS_GOOD = 0.95


def behind(gains: Mapping[int, float], bound: Collection[int] = ()) -> list[int]:
    """Which of some rough fits are not worth a thorough one, by what each gains.

    Parameters
    ----------
    gains : mapping of int to float
    bound : collection of int
        Those that a rough fit knows too little of: they are not counted.
    """
    ranked = sorted(gains, key=lambda k: -gains[k])
    least = CLOSE_SHARE * gains[ranked[0]]
    counted = [k for k in ranked if k not in bound]
    # The best always: where a delay has to move first, none is any good until it has.
    late = {k for n, k in enumerate(counted) if n >= _THOROUGH}
    return [k for n, k in enumerate(ranked) if k in late or (n and gains[k] < least)]


def of_all_valves(term: ActiveEffect) -> bool:
    """Whether it is a delay that no valve may be without: a rough fit takes it off those again."""
    return term.effect.name == DELAY and term.cylinder is None


def best_of_each(contenders: Sequence[Contender]) -> list[Contender]:
    """Of every effect and target the fit that gains most, in the order given."""
    best: dict[tuple[str, str], Contender] = {}
    for one in contenders:
        key = (one.term.effect.name, one.term.target)
        if key not in best or one.gain > best[key].gain:
            best[key] = one
    return list(best.values())


def firsts(scores: Sequence[Score]) -> list[Score]:
    """The best shape of every effect and target, best first."""
    seen: dict[tuple[str, str], Score] = {}
    for one in sorted(scores, key=lambda s: -s.value):
        trial = one.entry.trial
        seen.setdefault((trial.name, trial.target), one)
    return list(seen.values())


def leading(contenders: Sequence[Contender], told: Sequence[Contender]) -> Contender:
    """The contender that held-out blocks speak for most.

    What cannot be the cause, as a contact that a joint never leaves, may have the form of what
    can, and come before it by a hair: that is then no reason to name neither.

    Parameters
    ----------
    contenders : sequence of Contender
    told : sequence of Contender
        Those of them that can be the cause.
    """
    first = max(contenders, key=lambda c: c.held_out)
    possible = max(told, key=lambda c: c.held_out, default=first)
    return possible if possible.held_out >= _AS_GOOD * first.held_out else first
