"""Findings put to recordings, or whole blocks, that took no part in anything.

A finding stands where the model without it, refitted on the training rows, predicts these rows
worse by more than sign flips of whole blocks explain, and where a placebo of equal freedom, the
same contribution at other times, does not do as well. The finding itself is taken as it was found;
rows are looked at as they are predicted, and with base and other effects refitted to them on
either side, so that what other motions make of their small errors speaks neither for nor against.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.agreement import Agreement, agreements
from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.candidates import instants_of
from hydro_ident.mismatch.check import Check, noise_there
from hydro_ident.mismatch.fitting import Fitted, fit, linearised
from hydro_ident.mismatch.modelled import same
from hydro_ident.mismatch.named import Named, at_a_bound
from hydro_ident.mismatch.prediction import Model, Predictor
from hydro_ident.mismatch.scoring import signs
from hydro_ident.mismatch.settings import BLOCK_S
from hydro_ident.mismatch.training import Training, layout_of
from hydro_ident.mismatch.whitening import IndexArray, Layout, Noise
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: A finding that improves held-out rows by chance more often than this does not stand.
VERIFIED = 0.1
#: What the next effect of a set has to be better by where one was refused: it is another question.
_FURTHER = 0.1
#: Nor does one with which a channel's held-out rows are predicted worse than this, rms.
WORSE = 1.05
#: Shifts of the placebo, as shares of a recording.
_SHIFTS = (0.17, 0.29, 0.37, 0.46, 0.57, 0.68, 0.83)
#: Correlation with the finding from which a shifted one is the same.
_ALIKE = 0.7
#: Blocks that a p-value needs, and the shortest that still are independent.
_LEAST_BLOCKS, _SHORTEST_BLOCK_S = 20, 0.2
#: Parts of a recording's time that are looked at for rows.
_PARTS = 200


@dataclass(frozen=True, slots=True)
class Verification:
    """How a finding did on rows that it never saw.

    Attributes
    ----------
    p_value : float
    before, after : dict of str to float
        Rmse by channel without and with it, as predicted or all else refitted to these rows:
        whichever tells more.
    placebo : float
        Improvement by the median placebo over the finding's own.
    stands : bool
    reason : str
        Why it does not.
    agreement : tuple of Agreement
        Its sizes here and there.
    """

    p_value: float
    before: dict[str, float]
    after: dict[str, float]
    placebo: float
    stands: bool
    reason: str
    agreement: tuple[Agreement, ...] = ()


def verify(
    training: Training,
    whole: Fitted,
    named: Named,
    check: Check,
    there: Fitted | None = None,
    tried: int = 1,
    shown: Sequence[str] = (),
    passes: int = 2,
) -> Verification:
    """Put one finding to the check.

    Parameters
    ----------
    training : Training
    whole : Fitted
        The final model.
    named : Named
    check : Check
    there : Fitted or None
        The final model, fitted anew to the check's rows.
    tried : int
        How many candidates it was chosen from.
    shown : sequence of str
        Channels in which it shows, none of which it may make worse; by default all it acts on.
    passes : int
        Of the fit without the finding.
    """
    mine = named.term
    rest = tuple(t for t in whole.model.terms if not same(t, mine))
    terms = [t for t in whole.model.terms if same(t, mine)]
    without = fit(training, replace(whole.model, terms=rest), whole.bench.noise, passes)
    material = training.predictor.material
    noise = noise_there(whole.bench.noise, material.channels, check.predictor.material.channels)
    model, instants = _at_own_instant(training, check, whole.model, mine)
    plain, with_it = check.residual(without.model), check.residual(model)
    placebos = _placebos(training, without, check, plain, whole.model, terms)
    acting = shown or _acting(check.predictor, model, terms)
    looks = [
        _looked(_Rows.of(check, without.model, noise, refit), plain, with_it, placebos, acting)
        for refit in (False, True)
    ]
    # Two ways of looking, either of which may tell: both are paid for.
    looks = [replace(one, p_value=min(1.0, len(looks) * instants * one.p_value)) for one in looks]
    least = VERIFIED * _FURTHER**named.refused
    best = min(looks, key=lambda one: (bool(_against(one, least)), one.p_value))
    agreement = agreements(whole, there, terms)
    reason = at_a_bound(mine) or _idle(without.squares - whole.squares, named, tried)
    reason = reason or _against(best, least) or _apart(agreement)
    return Verification(best.p_value, *best.sides, best.placebo, not reason, reason, agreement)


@dataclass(frozen=True, slots=True)
class _Look:
    """What held-out rows say, seen in one way.

    Attributes
    ----------
    p_value : float
    placebo : float
        As `Verification`.
    against : float
        Chance that the finding beats a median placebo.
    sides : (dict, dict) of str to float
        Rmse by channel without and with it.
    worse : str
        What speaks against it in a channel.
    """

    p_value: float
    placebo: float
    against: float
    sides: tuple[dict[str, float], dict[str, float]]
    worse: str


def _looked(
    rows: _Rows,
    plain: FloatArray,
    with_it: FloatArray,
    placebos: Sequence[FloatArray],
    acting: Sequence[str],
) -> _Look:
    before, after = rows.left(plain), rows.left(with_it)
    others = [rows.left(residual) for residual in placebos]
    gains = rows.gains(before, after)
    real = float(gains.sum())
    shares = [float(rows.gains(before, other).sum()) for other in others]
    # What is the same at all times has no placebo.
    share = float(np.median(shares)) / real if shares and real > 0.0 else float(real > 0.0)
    against = [chance(rows.gains(other, after)) for other in others]
    sides = rows.rmse(plain), rows.rmse(with_it)
    median = float(np.median(against or [0.0]))
    return _Look(chance(gains), share, median, sides, _worse(sides, acting))


def _against(one: _Look, least: float) -> str:
    """What speaks against a finding, seen in one way; empty where nothing does."""
    if one.worse:
        return one.worse
    if one.p_value > least:
        return f"held-out rows are not predicted better with it (p = {one.p_value:.2g})"
    if one.against > VERIFIED:
        return f"a placebo of equal freedom predicts held-out rows as well ({one.placebo:.0%})"
    return ""


def _at_own_instant(
    training: Training, check: Check, model: Model, mine: ActiveEffect
) -> tuple[Model, int]:
    """A model for the check: what begins at an instant does so at another one in other recordings.

    Returns
    -------
    model : Model
        With the instant that predicts the check best.
    tried : int
        How many were looked at: the p-value pays for them.
    """
    start = mine.effect.start
    if not start or check.predictor is training.predictor:
        return model, 1
    at = [p.name for p in mine.effect.parameters].index(start)
    used, best, least = check.mask & check.moving, model, np.inf
    instants = [float(mine.parameters[at]), 0.0, *instants_of(check.predictor.material)]
    for instant in instants:
        values = mine.parameters.copy()
        values[at] = instant
        terms = tuple(replace(t, parameters=values) if same(t, mine) else t for t in model.terms)
        tried = replace(model, terms=terms)
        left = float(np.sum(check.residual(tried)[used] ** 2))
        if left < least:
            best, least = tried, left
    return best, len(instants)


def _idle(gain: float, named: Named, tried: int) -> str:
    """Whether a finding no longer stands out on the training rows themselves.

    What it was found beside may have been withdrawn since: its parameters have to pay still, for
    its choice among so many as well.
    """
    least = 2.0 * named.spread * (named.modelled.cost + math.log(max(tried, 1)))
    if gain >= least:
        return ""
    return (
        "beside the other findings it no longer stands out on the training rows"
        f" (gain {gain:.3g}, at least {least:.3g})"
    )


def _worse(sides: Sequence[Mapping[str, float]], acting: Sequence[str]) -> str:
    """Whether a channel that a finding acts on is predicted worse with it."""
    before, after = sides
    known = [n for n in acting if n in before] or list(before)
    worse = max(known, key=lambda n: after[n] / max(before[n], 1e-300))
    if after[worse] <= WORSE * before[worse]:
        return ""
    return (
        f"held-out rows of {worse} are predicted worse with it (RMSE {before[worse]:.3g} to"
        f" {after[worse]:.3g})"
    )


def _apart(agreement: Sequence[Agreement]) -> str:
    """Which size differs from that on the training rows."""
    for one in agreement:
        if not one.agrees:
            return (
                f"its {one.name} is {one.training:.3g} {one.unit} on the training rows and"
                f" {one.held_out:.3g} +- {one.std:.2g} on held-out ones"
            )
    return ""


def _acting(predictor: Predictor, model: Model, terms: Sequence[ActiveEffect]) -> list[str]:
    """Channels whose prediction some terms change; all where none does."""
    material = predictor.material
    column = sum((predictor.contribution(model, t) for t in terms), np.zeros(material.size))
    names = [n for k, n in enumerate(material.channels) if column[material.channel == k].any()]
    return names or list(material.channels)


@dataclass(frozen=True, slots=True)
class _Rows:
    """Held-out rows as they are, or behind a refit of all but the finding to them.

    Attributes
    ----------
    check : Check
    bench : Bench
        Of the residual without the finding.
    columns : (N, p) array
        What a refit may move, on all rows; zeros for none.
    used : (N,) bool array
    """

    check: Check
    bench: Bench
    columns: FloatArray
    used: BoolArray

    @staticmethod
    def of(check: Check, model: Model, noise: Noise, refit: bool) -> _Rows:
        used = check.mask & check.moving
        residual, columns, _ = linearised(check.predictor, model)
        columns = columns if refit else np.zeros((residual.size, 1))
        layout = layout_of(check.predictor).take(used)
        bench = Bench(layout, noise, residual[used], columns[used], BLOCK_S)
        return _Rows(check, bench, columns, used)

    def left(self, residual: FloatArray) -> FloatArray:
        """What a refit leaves of a residual (N,), whitened, (M,)."""
        return self.bench.beyond(residual[self.used][:, None])[:, 0]

    def gains(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Improvement of the whitened squared errors by block of time."""
        layout, rows = self.bench.layout, self.bench.rows
        lengths = [float(np.ptp(layout.time_s[layout.recording == r])) for r in _each(layout)]
        # So few blocks that no flip could be rare would reject whatever is put to them.
        share = float(np.mean(np.isin(np.arange(_PARTS), _parts(layout))))
        block_s = min(BLOCK_S, max(sum(lengths) * share / _LEAST_BLOCKS, _SHORTEST_BLOCK_S))
        block = layout.blocks(block_s)[rows]
        sums = np.bincount(block, weights=before**2 - after**2)
        return np.asarray(sums[sums != 0.0])

    def rmse(self, residual: FloatArray) -> dict[str, float]:
        """What a refit leaves of a residual (N,) by channel, in its unit."""
        left = residual - self.columns @ self.bench.refit(residual[self.used])
        names = self.check.predictor.material.channels
        return {n: _rms(left[self.check.rows(k, n) & self.used]) for k, n in enumerate(names)}


def _each(layout: Layout) -> IndexArray:
    return np.unique(layout.recording)


def _parts(layout: Layout) -> IndexArray:
    """Which parts of the recordings' time hold rows."""
    end = float(layout.time_s.max(initial=0.0)) or 1.0
    return np.unique(np.minimum((layout.time_s / end * _PARTS).astype(np.intp), _PARTS - 1))


def chance(gains: FloatArray) -> float:
    """Share of sign flips that reach the sum of blocks' gains; 1 where there is none."""
    if not gains.size or gains.sum() <= 0.0:
        return 1.0
    drawn = signs(gains.size) @ gains
    return float((1 + np.sum(drawn >= gains.sum())) / (1 + drawn.size))


def _placebos(
    training: Training,
    without: Fitted,
    check: Check,
    plain: FloatArray,
    model: Model,
    terms: Sequence[ActiveEffect],
) -> list[FloatArray]:
    """Residuals on all rows with a finding's contribution at other times in its place.

    Shifts after which it is still much the same are no placebo.
    """
    if not terms:
        return []
    own = training.predictor.contribution(model, terms[0])
    there = check.predictor.contribution(model, terms[0])
    mask = training.mask
    real = without.bench.beyond(own[mask][:, None])[:, 0]
    result = []
    for shift in _SHIFTS:
        column = _rolled(training.predictor, own, shift)
        moved = without.bench.beyond(column[mask][:, None])[:, 0]
        sizes = float(np.linalg.norm(moved) * np.linalg.norm(real))
        if abs(float(moved @ real)) > _ALIKE * sizes:
            continue
        step = float(moved @ without.bench.residual) / max(float(moved @ moved), 1e-300)
        result.append(plain - step * _rolled(check.predictor, there, shift))
    return result


def _rolled(predictor: Predictor, values: FloatArray, shift: float) -> FloatArray:
    """Values shifted in time around each channel of each recording."""
    material = predictor.material
    result = values.copy()
    for place in material.places:
        count = place.rows.stop - place.rows.start
        result[place.rows] = np.roll(values[place.rows], round(shift * count))
    return result


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
