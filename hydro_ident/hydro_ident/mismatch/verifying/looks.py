"""What rows that took no part say of a finding, seen in one way: as predicted or refitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from hydro_ident.mismatch.split.held_out import SHORTEST_HELD_OUT_S, HeldOut
from hydro_ident.mismatch.trials.products import chance_beside, share_of_time
from hydro_model.robot import FloatArray

#: A placebo does as well where chance beats it more often than this; nor is dependence without a
#: name confirmed that chance makes more often.
VERIFIED = 0.1
#: No finding stands with which a channel's held-out rows are predicted worse than this, rms.
WORSE = 1.05
#: Share of rmse that a finding has to take off somewhere: any model is off by as much.
_SEEN = 2.5e-4
#: Deviations that are exceeded on one side once in forty times.
_ONE_IN_FORTY = 1.96
#: What a finding has to be able to gain on held-out rows before these can tell: two deviations.
SHOWN = 4.0
#: Share of the short blocks from which a finding acts all along, not in a few instants.
_LASTING = 0.25


@dataclass(frozen=True, slots=True)
class Look:
    """What held-out rows say, seen in one way.

    Attributes
    ----------
    p_value : float
    placebo : float
        As `Verification`.
    against : float
        Chance that the finding beats a median placebo.
    shown : float
        Sum of squares, weighed by noise and the model's error, of what the finding changes here:
        what it would gain if it were true.
    sides : (dict, dict) of str to float
        Rmse by channel without and with it.
    worse : str
        What speaks against it in a channel.
    instants : int
        From how many it had to choose on these rows when it comes and goes.
    unseen : bool
        It makes no channel better by what anybody would see.
    """

    p_value: float
    placebo: float
    against: float
    shown: float
    sides: tuple[dict[str, float], dict[str, float]]
    worse: str
    instants: int = 1
    unseen: bool = False

    @property
    def paid(self) -> float:
        """The p-value with the choice among instants paid for, at most 1."""
        return min(1.0, self.instants * self.p_value)


def looked(
    rows: HeldOut,
    plain: FloatArray,
    with_it: FloatArray,
    placebos: Sequence[FloatArray],
    acting: Sequence[str],
    tried: float = 1.0,
) -> Look:
    """Look at held-out rows in one way.

    Parameters
    ----------
    rows : HeldOut
    plain, with_it : (N,) array
        Residuals without the finding and with it.
    placebos : sequence of (N,) array
        With a placebo in its place.
    acting : sequence of str
        Channels that it acts on.
    tried : float
        As `chance_beside`.
    """
    before, after = rows.left(plain), rows.left(with_it)
    change = before - after
    real = _gain(before, change)
    others = [before - rows.left(residual) for residual in placebos]
    shares = [_gain(before, other) for other in others]
    # What is the same at all times has no placebo: none does as well.
    share = float(np.median(shares)) / real if shares and real > 0.0 else 0.0
    # Products with what is left without the finding: those of a false one are as often negative,
    # whereas its gain is negative by itself, and asks twice the size of a true one.
    block = rows.blocks(), rows.blocks(SHORTEST_HELD_OUT_S)
    p = chance_beside(change, before, after, *block, tried) if real > 0.0 else 1.0
    p = max(p, _by_error(rows, before, change))
    against = [chance_beside(change - other, before, after, *block) for other in others]
    sides = rows.rmse(plain), rows.rmse(with_it)
    lasting = share_of_time(change, block[1]) >= _LASTING
    median = float(np.median(against or [0.0]))
    shown = float(change @ rows.weighed(change))
    unseen = _unseen(sides, acting)
    worse = _worse(sides, acting, lasting and unseen)
    return Look(p, share, median, shown, sides, worse, unseen=unseen)


def _by_error(rows: HeldOut, before: FloatArray, change: FloatArray) -> float:
    """Chance that the model's own error goes with a change: one draw for all blocks, no flip's."""
    if not rows.doubt.size:
        return 0.0
    weighed = rows.weighed(change)
    error = rows.error(weighed)
    return float(norm.sf(float(before @ weighed) / error)) if error > 0.0 else 1.0


def _gain(before: FloatArray, change: FloatArray) -> float:
    """What a change takes off the sum of squares."""
    return float(2.0 * before @ change - change @ change)


def missed(shown: float) -> float:
    """Chance of held-out rows that a true finding stays above once in forty times.

    Parameters
    ----------
    shown : float
        As `Look`, over the sums' overdispersion: the mean of its product with what is left, whose
        deviation is the root.
    """
    return float(norm.sf(np.sqrt(max(shown, 0.0)) - _ONE_IN_FORTY))


def objection(one: Look, least: float) -> str:
    """What speaks against a finding, seen in one way; empty where nothing does.

    Parameters
    ----------
    one : Look
    least : float
        Largest p-value, instants paid for, with which it stands.
    """
    if one.worse:
        return one.worse
    if one.paid > least:
        return f"held-out rows are not predicted better with it (p = {one.paid:.2g})"
    if one.against > VERIFIED:
        return f"a placebo of equal freedom predicts held-out rows as well ({one.placebo:.0%})"
    return ""


def _unseen(sides: Sequence[Mapping[str, float]], acting: Sequence[str]) -> bool:
    """Whether no channel that a finding acts on is predicted better with it.

    Weighed by the noise it may still gain; a fit that nobody can see improve did not.
    """
    before, after = sides
    known = [n for n in acting if n in before] or list(before)
    return bool(known) and all(after[n] > (1.0 - _SEEN) * before[n] for n in known)


def _worse(sides: Sequence[Mapping[str, float]], acting: Sequence[str], unseen: bool) -> str:
    """Whether a channel that a finding acts on is predicted worse with it, or none better.

    What acts in a few instants, such as a play, is not judged by the mean over rows that a refit
    has moved (`unseen`).
    """
    before, after = sides
    known = [n for n in acting if n in before] or list(before)
    if unseen:
        return f"held-out rows of {', '.join(known)} are predicted no better with it"
    worse = max(known, key=lambda n: after[n] / max(before[n], 1e-300))
    if after[worse] <= WORSE * before[worse]:
        return ""
    return (
        f"held-out rows of {worse} are predicted worse with it (RMSE {before[worse]:.3g} to"
        f" {after[worse]:.3g})"
    )
