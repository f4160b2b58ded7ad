"""How much trials gain beyond a refit, and how much of that could be chance."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.bench import Bench, Partial
from hydro_ident.mismatch.candidates import Trial, trials
from hydro_ident.mismatch.prediction import Model, Predictor, shapes
from hydro_ident.mismatch.settings import FLIPS, SEED
from hydro_model.robot import FloatArray

#: A column of which a refit swallows all but this share says nothing of its own.
SWALLOWED = 1.0e-5
#: Columns of a trial within this share of each other's span count once.
_COLLINEAR = 1.0e-6
#: Effects that balances cannot tell: a chamber's pressure answers to whatever flow the valve adds
#: by chance, and what follows its rise then follows the noise.
_TOLD_BY_FORCES = ("pressure_delay",)
#: Trials whose columns are taken at a time, and the least share of noise that fits leave.
_TOGETHER, _LEAST_LEFT = 40, 0.05
#: Value that no chance reaches in a channel by itself, over all trials.
_STANDS_OUT = 40.0
#: Gain of a block that tells an effect by itself: three deviations and a bit.
_TELLING = 10.0
#: What a further coefficient gains by chance, in a maximum over many.
_PER_COEFFICIENT = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A trial with its columns on the rows where they are not zero.

    Attributes
    ----------
    trial : Trial
    rows : (N,) bool array
        M of the stacked rows.
    values : (M, k) float32 array
    """

    trial: Trial
    rows: BoolArray
    values: FloatArray

    def columns(self, size: int) -> FloatArray:
        """The columns on all rows, (N, k)."""
        full = np.zeros((size, self.values.shape[1]))
        full[self.rows] = self.values
        return full


def bank_of(predictor: Predictor, model: Model, chosen: Sequence[Trial]) -> list[Entry]:
    """Evaluate trials once; shapes that do nothing in these recordings are left out."""
    material, entries = predictor.material, list[Entry]()
    channel = material.channel
    forces = [k for k in range(len(material.channels)) if not material.is_flow(k)]
    for trial in chosen:
        columns = trial.columns(predictor, model)
        if not np.isfinite(columns).all() or not columns.any():
            continue
        acting = [k for k in np.unique(channel) if columns[channel == k].any()]
        if trial.name in _TOLD_BY_FORCES and set(acting) & set(forces):
            acting = forces
        rows = np.isin(channel, acting)
        entries.append(Entry(trial, rows, columns[rows].astype(np.float32)))
    return entries


class Bank:
    """Columns of every trial, evaluated once for all that look at them.

    They are those beside the model that asked first: what a refit moves changes them little. Laws
    that act beside one that shapes the same cylinder's valve signal are evaluated anew.

    Parameters
    ----------
    predictor : Predictor
    """

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor
        self._kept: dict[tuple[object, ...], list[Entry]] = {}

    def entries(
        self, model: Model, excluded: Collection[tuple[str, str]] = frozenset()
    ) -> list[Entry]:
        """Columns of everything that is not in a model.

        Parameters
        ----------
        model : Model
        excluded : collection of (str, str)
            Effects and targets that are left out.
        """
        result: list[Entry] = []
        groups: dict[tuple[str, str], list[Trial]] = {}
        for trial in trials(self._predictor, model):
            if (trial.name, trial.target) not in excluded:
                groups.setdefault((trial.name, trial.target), []).append(trial)
        for key, own in groups.items():
            active = own[0].active
            shaping = tuple(
                (t.effect.name, t.target)
                for t in model.terms
                if shapes(t) and active.cylinder in (None, t.cylinder)
            )
            if active.effect.channel == "force":
                shaping = ()
            if (*key, *shaping) not in self._kept:
                self._kept[(*key, *shaping)] = bank_of(self._predictor, model, own)
            result += self._kept[(*key, *shaping)]
        return result


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """What one trial gains.

    Attributes
    ----------
    entry : Entry
    gain : float
        Reduction of the sum of squares, in units of the white noise's variance.
    coefficients : (k,) array
        Zero for columns that were not used.
    std : (k,) array
        Deviation of each coefficient by itself.
    partial : Partial
    """

    entry: Entry
    gain: float
    coefficients: FloatArray
    std: FloatArray
    partial: Partial

    @property
    def value(self) -> float:
        """The gain, less what its number of coefficients gains by chance."""
        return self.gain - _PER_COEFFICIENT * (np.count_nonzero(self.coefficients) - 1)


def score(
    bench: Bench, entry: Entry, mask: BoolArray, left_over: FloatArray | None = None
) -> Score | None:
    """Score one trial; None where a refit swallows it.

    Parameters
    ----------
    bench : Bench
    entry : Entry
    mask : (N,) bool array
        Training rows of the material, which `bench` is of.
    left_over : array, optional
        Whitened residual without the best trial, for `chance_of`.
    """
    partial = bench.partial(entry.columns(mask.size)[mask], left_over)
    kept = np.diag(partial.gram) > SWALLOWED * partial.plain
    if not kept.any():
        return None
    sums = partial.scores.sum(axis=0)[None]
    gains, coefficients = best_subset(partial.gram, sums, entry.trial.signed, kept)
    with np.errstate(divide="ignore"):
        std = np.where(kept, 1.0 / np.sqrt(np.diag(partial.gram)), np.inf)
    return Score(entry, float(gains[0]), coefficients[0], std, partial)


def best_subset(
    gram: FloatArray, sums: FloatArray, signed: Sequence[bool], kept: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Largest gain over subsets of columns whose coefficients have possible signs.

    Parameters
    ----------
    gram : (k, k) array
    sums : (M, k) array
        Products with M residuals.
    signed : sequence of bool
        Which coefficients may be negative.
    kept : (k,) bool array
        Columns that may be used.

    Returns
    -------
    gains : (M,) array
    coefficients : (M, k) array
    """
    count = gram.shape[0]
    gains = np.zeros(sums.shape[0])
    coefficients = np.zeros_like(sums)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    for number in range(1, count + 1):
        for subset in itertools.combinations(np.flatnonzero(kept).tolist(), number):
            at = list(subset)
            scaled = gram[np.ix_(at, at)] / np.outer(size[at], size[at])
            if number > 1 and np.linalg.eigvalsh(scaled)[0] < _COLLINEAR:
                continue
            found = np.linalg.solve(scaled, (sums[:, at] / size[at]).T).T / size[at]
            gain = np.sum(found * sums[:, at], axis=1)
            possible = np.all((found >= 0.0) | np.array([signed[i] for i in at]), axis=1)
            worth = gain - _PER_COEFFICIENT * (number - 1)
            have = gains - _PER_COEFFICIENT * np.maximum(
                np.count_nonzero(coefficients, axis=1) - 1, 0
            )
            better = possible & (worth > have)
            gains = np.where(better, gain, gains)
            coefficients[better] = 0.0
            rows = np.flatnonzero(better)
            for position, column in enumerate(at):
                coefficients[rows, column] = found[rows, position]
    return gains, coefficients


def signs(blocks: int, flips: int = FLIPS) -> FloatArray:
    """Signs of `flips` draws of `blocks` whole blocks, (F, B): always the same."""
    rng = np.random.default_rng(SEED)
    return np.where(rng.random((flips, blocks)) < 0.5, -1.0, 1.0)


def effective_blocks(bench: Bench, one: Score, mask: BoolArray) -> float:
    """How many blocks a trial's strongest column is worth: of equal weight, or that stand out.

    Where one block holds most of it, others may still each tell it by themselves; of those one is
    left out, since an event may lie in two.
    """
    used = int(np.argmax(np.abs(one.coefficients) / one.std))
    left = bench.beyond(one.entry.columns(mask.size)[mask][:, used : used + 1])
    scores = bench.by_block(left * bench.residual[:, None])[:, 0]
    squares = bench.by_block(left**2)[:, 0]
    size = scores.sum() / max(float(squares.sum()), 1e-300)
    telling = np.count_nonzero(2.0 * size * scores - size**2 * squares >= _TELLING)
    return max(bench.spread(left[:, 0]), float(telling - 1))


def foremost(scores: Sequence[Score]) -> list[Score]:
    """The best trial, and of those that share no rows with better ones what stands out as far.

    Parameters
    ----------
    scores : sequence of Score
        At least one.
    """
    order = sorted(scores, key=lambda one: -one.value)
    taken, result = order[0].entry.rows.copy(), [order[0]]
    for one in order[1:]:
        if one.value < _STANDS_OUT:
            break
        if not (one.entry.rows & taken).any():
            taken |= one.entry.rows
            result.append(one)
    return result


def used_columns(chosen: Sequence[Score], size: int) -> FloatArray:
    """Columns that some trials used, side by side, (N, k)."""
    used = [one.entry.columns(size)[:, one.coefficients != 0.0] for one in chosen]
    return np.concatenate(used, axis=1)


def lost_by_fits(
    bench: Bench, scores: Sequence[Score], taken: Sequence[Score], mask: BoolArray
) -> list[FloatArray]:
    """What every column's products with the residual are to be raised by, (k,) of each trial.

    A refit of the base, and taking some trials out, make the residual of every block smaller
    than the noise: its products with a column c have the variance ``sum_b c_b' (I - Q Q')_bb c_b``
    with the fit's directions Q, where noise itself would give ``c' c``.
    """
    fresh = bench.beyond(used_columns(taken, mask.size)[mask])
    directions = np.concatenate([bench.basis, np.linalg.qr(fresh)[0]], axis=1)
    order = np.argsort(bench.block, kind="stable")
    edges = np.searchsorted(bench.block[order], np.arange(bench.blocks + 1))
    directions = directions[order]
    result: list[FloatArray] = []
    for begin in range(0, len(scores), _TOGETHER):
        some = scores[begin : begin + _TOGETHER]
        columns = [one.entry.columns(mask.size)[mask] for one in some]
        left = bench.beyond(np.concatenate(columns, axis=1))[order]
        lost = np.zeros(left.shape[1])
        for a, b in itertools.pairwise(edges.tolist()):
            lost += np.sum((directions[a:b].T @ left[a:b]) ** 2, axis=0)
        whole = np.maximum(np.sum(left**2, axis=0), 1e-300)
        raised = 1.0 / np.sqrt(np.maximum(1.0 - lost / whole, _LEAST_LEFT))
        result += np.split(raised, np.cumsum([c.shape[1] for c in columns])[:-1])
    return result


def told_best(one: Score) -> int:
    """A trial's column whose coefficient is told best."""
    return int(np.argmax(np.abs(one.coefficients) / one.std))


def overdispersion(one: Score, raised: FloatArray | None = None) -> float:
    """How much more a trial's sums over blocks vary than independent rows' would; at least 1.

    Where a channel holds more than its noise, whatever is put to it gains by chance: that is no
    measure of what trials of other channels gain.

    Parameters
    ----------
    one : Score
    raised : (k,) array, optional
        As `lost_by_fits`.
    """
    told = told_best(one)
    own = float(one.partial.gram[told, told])
    if own <= SWALLOWED * one.partial.plain[told]:
        return 1.0
    factor = 1.0 if raised is None else float(raised[told])
    return max(1.0, factor**2 * float(np.sum(one.partial.chance[:, told] ** 2)) / own)


def chance_of(
    scores: Sequence[Score], flips: FloatArray, raised: Sequence[FloatArray] | None = None
) -> FloatArray:
    """The largest value of any trial under every sign flip, over its `overdispersion`.

    Westfall and Young, Resampling-Based Multiple Testing (1993): statistics are brought to one
    scale before their maximum is taken, lest the widest decide for all.

    Parameters
    ----------
    scores : sequence of Score
        Of a residual without the best trials in it: what is left is what chance has to work with.
    flips : (F, B) array
    raised : sequence of (k,) array, optional
        As `lost_by_fits`.
    """
    largest = np.zeros(flips.shape[0])
    for k, one in enumerate(scores):
        own = None if raised is None else raised[k]
        drawn = flips @ one.partial.chance / np.sqrt(overdispersion(one, own))
        if own is not None:
            drawn *= own
        kept = np.diag(one.partial.gram) > SWALLOWED * one.partial.plain
        gains, coefficients = best_subset(one.partial.gram, drawn, one.entry.trial.signed, kept)
        extra = np.maximum(np.count_nonzero(coefficients, axis=1) - 1, 0)
        largest = np.maximum(largest, gains - _PER_COEFFICIENT * extra)
    return largest


def chances(
    scores: Sequence[Score],
    chosen: Sequence[Score],
    flips: FloatArray,
    raised: Sequence[FloatArray] | None = None,
) -> tuple[float, ...]:
    """Chance that any trial reaches what a trial does, each by its own scale.

    Parameters
    ----------
    scores : sequence of Score
        All that share the family's error.
    chosen : sequence of Score
        Of these, whose chances are wanted.
    flips, raised
        As `chance_of`.
    """
    chance = chance_of(scores, flips, raised)
    own = {id(s): None if raised is None else raised[k] for k, s in enumerate(scores)}
    return tuple(p_value(one.value / overdispersion(one, own[id(one)]), chance) for one in chosen)


def p_value(value: float, chance: FloatArray) -> float:
    """Share of draws that reach a value, the observed one counted in."""
    return float((1 + np.sum(chance >= value)) / (1 + chance.size))
