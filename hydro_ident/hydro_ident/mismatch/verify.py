"""Findings put to recordings, or whole blocks, that took no part in anything.

A finding stands where the model without it, refitted on the training rows, predicts these rows
worse by more than sign flips of whole blocks explain, and where a placebo of equal freedom, the
same contribution at other times, does not do as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.fitting import Fitted, fit, linearised
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
class Check:
    """Rows that took no part in fitting or selecting.

    Attributes
    ----------
    predictor : Predictor
        Of the training material, or of other recordings.
    mask : (N,) bool array
    moving : (N,) bool array
        Rows on which friction laws can be judged.
    """

    predictor: Predictor
    mask: BoolArray
    moving: BoolArray

    def residual(self, model: Model) -> FloatArray:
        """Residual of a model on all rows of the material."""
        return self.predictor.residual(model)

    def rows(self, channel: int, name: str) -> BoolArray:
        """The check's rows of a channel, by its name."""
        material = self.predictor.material
        at = material.channels.index(name) if name in material.channels else -1
        return np.asarray(self.mask & (material.channel == at))


@dataclass(frozen=True, slots=True)
class Verification:
    """How a finding did on rows that it never saw.

    Attributes
    ----------
    p_value : float
    before, after : dict of str to float
        Rmse by channel without and with it, everything else the same.
    placebo : float
        Improvement by the median placebo over the finding's own.
    stands : bool
    reason : str
        Why it does not.
    """

    p_value: float
    before: dict[str, float]
    after: dict[str, float]
    placebo: float
    stands: bool
    reason: str


def verify(
    training: Training, whole: Fitted, named: Named, check: Check, passes: int = 2
) -> Verification:
    """Put one finding to the check."""
    mine = named.term
    rest = tuple(
        t
        for t in whole.model.terms
        if not (t.effect.name == mine.effect.name and t.target == mine.target)
    )
    terms = [t for t in whole.model.terms if t not in rest]
    without = fit(training, replace(whole.model, terms=rest), whole.bench.noise, passes)
    before, after = check.residual(without.model), check.residual(whole.model)
    noise, used = whole.bench.noise, check.mask & check.moving
    layout = layout_of(check.predictor).take(used)
    gains = _gains(layout, noise, before[used], after[used])
    p = chance(gains)
    real = float(gains.sum())
    tried = _placebos(training, without, check, whole.model, terms)
    shares = [float(_gains(layout, noise, before[used], r[used]).sum()) for r in tried]
    # What is the same at all times has no placebo.
    share = float(np.median(shares)) / real if tried and real > 0.0 else float(real > 0.0)
    against = [chance(_gains(layout, noise, r[used], after[used])) for r in tried]
    names = check.predictor.material.channels
    sides = [{n: _rms(r[check.rows(k, n)]) for k, n in enumerate(names)} for r in (before, after)]
    acting = _acting(check.predictor, whole.model, terms)
    worse = max(acting, key=lambda n: sides[1][n] / max(sides[0][n], 1e-300))
    reason = at_a_bound(mine)
    if reason:
        pass
    elif sides[1][worse] > WORSE * sides[0][worse]:
        reason = (
            f"held-out rows of {worse} are predicted worse with it (RMSE {sides[0][worse]:.3g} to"
            f" {sides[1][worse]:.3g})"
        )
    elif p > VERIFIED:
        reason = f"held-out rows are not predicted better with it (p = {p:.2g})"
    elif float(np.median(against or [0.0])) > VERIFIED:
        reason = f"a placebo of equal freedom predicts held-out rows as well ({share:.0%})"
    return Verification(p, sides[0], sides[1], float(share), not reason, reason)


def _acting(predictor: Predictor, model: Model, terms: Sequence[ActiveEffect]) -> list[str]:
    """Channels whose prediction some terms change; all where none does."""
    material = predictor.material
    column = sum((predictor.contribution(model, t) for t in terms), np.zeros(material.size))
    names = [n for k, n in enumerate(material.channels) if column[material.channel == k].any()]
    return names or list(material.channels)


def _gains(layout: Layout, noise: Noise, before: FloatArray, after: FloatArray) -> FloatArray:
    """Improvement of the whitened squared errors by block of time."""
    rows = noise.settled(layout)
    white = [noise.whitened(layout, r)[rows] ** 2 for r in (before, after)]
    lengths = [float(np.ptp(layout.time_s[layout.recording == r])) for r in _each(layout)]
    # So few blocks that no flip could be rare would reject whatever is put to them.
    share = float(np.mean(np.isin(np.arange(_PARTS), _parts(layout))))
    block_s = min(BLOCK_S, max(sum(lengths) * share / _LEAST_BLOCKS, _SHORTEST_BLOCK_S))
    block = layout.blocks(block_s)[rows]
    sums = np.bincount(block, weights=white[0] - white[1])
    return np.asarray(sums[sums != 0.0])


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
    before, others, names = linearised(check.predictor, without.model)
    # A last linear step that the fit without the finding did not take is no merit of a placebo.
    plain = dict(zip(without.names, without.bench.solve(), strict=True))
    result = []
    for shift in _SHIFTS:
        column = _rolled(training.predictor, own, shift)
        moved = without.bench.beyond(column[mask][:, None])[:, 0]
        sizes = float(np.linalg.norm(moved) * np.linalg.norm(real))
        if abs(float(moved @ real)) > _ALIKE * sizes:
            continue
        columns = np.concatenate([without.columns, column[:, None]], axis=1)
        bench = training.bench(without.bench.noise, without.residual, columns, without.offset)
        *rest, step = bench.solve()
        steps = dict(zip(without.names, rest, strict=True))
        # Everything else is refitted around the placebo, as it is around the finding.
        moves = [steps.get(name, 0.0) - plain.get(name, 0.0) for name in names]
        around = others @ np.array(moves)
        result.append(before - around - step * _rolled(check.predictor, there, shift))
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
