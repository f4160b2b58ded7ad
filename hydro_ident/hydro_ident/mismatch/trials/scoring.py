"""How much trials gain beyond a refit."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench, Partial, Witness
from hydro_ident.mismatch.rows.prediction import Model, Predictor, shapes
from hydro_ident.mismatch.trials.candidates import Trial, trials
from hydro_model.arrays import BoolArray
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: A column of which a refit swallows all but this share says nothing of its own.
SWALLOWED = 1.0e-5
#: Columns of a trial within this share of each other's span count once.
_COLLINEAR = 1.0e-6
#: Effects that balances cannot tell: a chamber's pressure answers to whatever flow the valve adds
#: by chance, and what follows its rise then follows the noise.
_TOLD_BY_FORCES = ("pressure_delay",)
#: What a further coefficient gains by chance, in a maximum over many.
PER_COEFFICIENT = 2.0


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

    They are those beside the model that asked first: what a refit moves changes them little. What
    acts beside a law that shapes the same cylinder's valve signal, its valve's flow or the rails,
    or a reading that is corrected, is evaluated anew.

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
            beside = [t for t in model.terms if _changes(t, own[0].active)]
            known = (*key, *((t.effect.name, t.target) for t in beside))
            if known not in self._kept:
                self._kept[known] = bank_of(self._predictor, model, own)
            result += self._kept[known]
        return result


def _changes(term: ActiveEffect, tried: ActiveEffect) -> bool:
    """Whether a term of a model makes the columns of what is tried other ones."""
    if tried.effect.channel == "force":
        # Of valves and rails a force knows nothing, and of how pressures are read next to nothing.
        return term.effect.reading is not None and term.joint is not None
    near = tried.cylinder is None or term.cylinder in (None, tried.cylinder)
    in_series = term.effect.needs_valve and (tried.effect.needs_valve or shapes(tried))
    return near and (shapes(term) or in_series or term.effect.reading is not None)


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
        return self.gain - PER_COEFFICIENT * (np.count_nonzero(self.coefficients) - 1)


def score(
    bench: Bench, entry: Entry, mask: BoolArray, left_over: Witness | None = None
) -> Score | None:
    """Score one trial; None where a refit swallows it.

    Parameters
    ----------
    bench : Bench
    entry : Entry
    mask : (N,) bool array
        Training rows of the material, which `bench` is of.
    left_over : Witness, optional
        Of the residual without the best trial, for `chance_of`.
    """
    partial = bench.partial(entry.values[mask[entry.rows]], left_over, entry.rows[mask])
    kept = np.diag(partial.gram) > SWALLOWED * partial.plain
    if not kept.any():
        return None
    sums = partial.scores.sum(axis=0)[None]
    gains, coefficients = best_subset(partial.gram, sums, entry.trial.signed, kept)
    with np.errstate(divide="ignore"):
        std = np.where(kept, 1.0 / np.sqrt(np.maximum(np.diag(partial.gram), 0.0)), np.inf)
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
    from hydro_ident.mismatch.trials.subset_kernels import best_single

    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    free = np.asarray(signed, dtype=bool)
    gains, coefficients = np.empty(sums.shape[0]), np.empty(sums.shape)
    best_single(size**2, np.ascontiguousarray(sums), free, kept, gains, coefficients)
    for number in range(2, gram.shape[0] + 1):
        for subset in itertools.combinations(np.flatnonzero(kept).tolist(), number):
            at = list(subset)
            scaled = gram[np.ix_(at, at)] / np.outer(size[at], size[at])
            if np.linalg.eigvalsh(scaled)[0] < _COLLINEAR:
                continue
            found = np.linalg.solve(scaled, (sums[:, at] / size[at]).T).T / size[at]
            gain = np.sum(found * sums[:, at], axis=1)
            possible = np.all((found >= 0.0) | free[at], axis=1)
            worth = gain - PER_COEFFICIENT * (number - 1)
            have = gains - PER_COEFFICIENT * np.maximum(
                np.count_nonzero(coefficients, axis=1) - 1, 0
            )
            better = possible & (worth > have)
            gains = np.where(better, gain, gains)
            coefficients[better] = 0.0
            rows = np.flatnonzero(better)
            for position, column in enumerate(at):
                coefficients[rows, column] = found[rows, position]
    return gains, coefficients
