"""A dependence without a name as a short form of its variable, where the data allow one.

A form is told where it gains almost what the free curve does, of fewer coefficients, and where it
predicts rows that took no part no worse than the curve. Forms that do as well as the best are told
together; where too many do, or none, nothing is. A form is a description, not a cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.locating.dependence import inverse_of
from hydro_ident.mismatch.locating.forms import CONSTANT, COSINE, Kind, kinds_for
from hydro_ident.mismatch.settings import FORM_TOLERANCE
from hydro_ident.mismatch.trials.chance import p_value, reached, signs
from hydro_ident.mismatch.unnamed.fit_form import (
    FittedForm,
    Rows,
    fit_kind,
    gain_of,
    needs_offset,
    theta_of,
)
from hydro_model.robot import FloatArray

#: Share of the free curve's gain that a form has to reach, on either rows.
ALMOST = 0.95
#: Share below which it is not told, even where held-out rows are too few to tell the two apart.
LEAST_HELD = 0.8
#: Chance level of a form on held-out rows, over all that are put to them; blocks that it takes.
HELD_OUT_ERROR, LEAST_BLOCKS = 0.01, 20
#: Held-out rows give a form another size beyond so many deviations and this share of it. A form is
#: a description: of another size it describes something else.
DEVIATIONS, SHARE = 4.0, 0.25
#: Level at which a form is worse than the curve, or than another form.
WORSE = 0.05
#: More forms than this that do equally well: the recordings do not tell a form.
MOST_TOLD = 4


@dataclass(frozen=True, slots=True)
class Curve:
    """The free curve of a dependence.

    Attributes
    ----------
    knots : (m,) array
        Between which it is straight.
    period : float
        After which it repeats, as a wave; 0 where it does not.
    any_phase : bool
        Whether held-out rows are of other times, so that a wave over time may be anywhere.
    """

    knots: FloatArray
    period: float = 0.0
    any_phase: bool = False


@dataclass(frozen=True, slots=True)
class Told:
    """A short form that held-out rows confirm.

    Attributes
    ----------
    fitted : FittedForm
    variable : str
        That it is of.
    share, held_share : float
        Its gain over the free curve's on training and on held-out rows.
    held_p_value : float
        Of its gain on held-out rows, under sign flips of whole blocks.
    """

    fitted: FittedForm
    variable: str
    share: float
    held_share: float
    held_p_value: float


@dataclass(frozen=True, slots=True)
class _Try:
    """A fitted form and the rows of its variable."""

    form: FittedForm
    train: Rows
    held: Rows

    def columns(self, rows: Rows) -> FloatArray:
        """Columns of the form on rows."""
        return rows.columns(self.form.kind, self.form.shape, self.form.offset)

    @property
    def function(self) -> FloatArray:
        """The form's whitened function on the training rows, the base refitted around it."""
        return self.train.beyond(self.columns(self.train), self.form.theta)


@dataclass(frozen=True, slots=True)
class _Held:
    """A form on held-out rows: improvement by block, its chance, and its size over that found."""

    blocks: FloatArray
    p_value: float
    size: float
    std: float

    def agrees(self, found_std: float) -> bool:
        """Whether these rows give a form the size that it was found with, to its deviation."""
        std = float(np.hypot(self.std, found_std))
        return abs(self.size - 1.0) <= max(DEVIATIONS * std, SHARE)


def told_forms(
    train: Rows, held: Rows, curve: Curve, twins: Sequence[tuple[Rows, Rows]] = ()
) -> tuple[Told, ...]:
    """Short forms that describe a dependence, the simplest first; none where none does.

    Parameters
    ----------
    train : Rows
        That the dependence was found on.
    held : Rows
        That took no part.
    curve : Curve
    twins : sequence of (Rows, Rows)
        The same over another variable that says where the machine is: what repeats may repeat
        over that one.
    """
    if held.bench.blocks < LEAST_BLOCKS or (curve.any_phase and not curve.period):
        return ()
    columns = train.curve(curve.knots, curve.period)
    full, rank = gain_of(train, columns)
    if full <= rank:
        return ()
    tries = _tries(train, held, curve, twins)
    tries = [one for one in tries if _short(one.form, full, rank, curve)]
    theta = theta_of(train, columns)
    by_curve = _held_out(held, held.curve(curve.knots, curve.period), theta, curve.any_phase)
    total = float(by_curve.blocks.sum())
    level = HELD_OUT_ERROR / max(len(tries), 1)
    kept = []
    for one in tries:
        seen_there = _held_out(one.held, one.columns(one.held), one.form.theta, curve.any_phase)
        good = seen_there.p_value <= level and seen_there.agrees(one.form.size_std)
        if good and _as_good(seen_there.blocks, by_curve.blocks):
            kept.append((one, seen_there))
    return tuple(
        Told(
            one.form, one.train.variable, one.form.gain / full,
            _share(float(there.blocks.sum()), total), there.p_value,
        )
        for one, there in _equals(kept)
    )  # fmt: skip


def _tries(
    train: Rows, held: Rows, curve: Curve, twins: Sequence[tuple[Rows, Rows]]
) -> list[_Try]:
    """Every form at its best, and what repeats over another variable."""
    tries = [_Try(form, train, held) for form in _fits(train, curve)]
    for seen, other in twins:
        form = fit_kind(seen, COSINE, False)
        tries += [] if form is None else [_Try(form, seen, other)]
    return tries


def _fits(train: Rows, curve: Curve) -> list[FittedForm]:
    """Every form at its best on the training rows, with a constant beside it if it takes one."""
    if curve.period:
        found = fit_kind(train, COSINE, False, curve.period)
        return [] if found is None else [found]
    return [f for f in (_with_constant(train, k) for k in kinds_for(train.at)) if f is not None]


def _with_constant(train: Rows, kind: Kind) -> FittedForm | None:
    """A form, with a constant beside it where it takes one."""
    plain = fit_kind(train, kind, False)
    more = None if kind is CONSTANT else fit_kind(train, kind, True)
    return more if needs_offset(plain, more) else plain


def _short(form: FittedForm, full: float, rank: int, curve: Curve) -> bool:
    """Whether a form gains almost what the curve does, of fewer coefficients."""
    fewer = form.freedom < rank or bool(curve.period)
    return fewer and form.net >= ALMOST * (full - rank)


def _held_out(held: Rows, columns: FloatArray, theta: FloatArray, any_phase: bool) -> _Held:
    """A function as it was found on held-out rows."""
    if any_phase:
        return _any_phase(held, columns, float(np.hypot(theta[0], theta[1])))
    white = held.beyond(columns, theta)
    products = held.bench.by_block((white * held.bench.residual)[:, None])[:, 0]
    return _Held(held.improvement(white), reached(products), *_size(held, white))


def _size(held: Rows, white: FloatArray) -> tuple[float, float]:
    """Factor on a whitened function (M,) that fits rows best, and its deviation."""
    squares = float(white @ white)
    if squares <= 0.0:
        return 0.0, 0.0
    size = float(white @ held.bench.residual) / squares
    rest = held.bench.residual - size * white
    by_block = held.bench.by_block((white * rest)[:, None])[:, 0]
    return size, float(np.sqrt(max(float(by_block @ by_block), squares))) / squares


def _any_phase(held: Rows, waves: FloatArray, size: float) -> _Held:
    """A wave of the size that was found on held-out rows, at each recording's own phase."""
    bench = held.bench
    white, gain, drawn = np.zeros(bench.count), 0.0, np.zeros(1)
    for k in np.unique(held.recording):
        pair = waves * (held.recording == k)[:, None]
        partial = bench.partial(pair)
        inverse = inverse_of(partial.gram)[1]
        sums = partial.scores.sum(axis=0)
        phase = inverse @ sums
        white += held.beyond(pair, phase * size / max(float(np.hypot(*phase)), 1e-300))
        # Flipped blocks choose their phase, too.
        flipped = signs(bench.blocks) @ partial.scores
        gain += float(sums @ phase)
        drawn = drawn + np.sum((flipped @ inverse) * flipped, axis=1)
    p = p_value(gain, drawn)
    return _Held(held.improvement(white), p, *_size(held, white))


def _as_good(form: FloatArray, curve: FloatArray) -> bool:
    """Whether held-out rows speak for a form as they do for the curve, by block."""
    gain, full = float(form.sum()), float(curve.sum())
    if gain <= 0.0 or gain < LEAST_HELD * full:
        return False
    return gain >= ALMOST * full or reached(curve - form) > WORSE


def _share(gain: float, full: float) -> float:
    """Of the curve's gain; one where the curve itself gains nothing."""
    return gain / full if full > 0.0 else 1.0


def _equals(told: Sequence[tuple[_Try, _Held]]) -> list[tuple[_Try, _Held]]:
    """Forms that do as well as the best, the simplest of them; none where they are too many."""
    if not told:
        return []
    blocks = [
        np.concatenate([one.train.improvement(one.function), there.blocks]) for one, there in told
    ]
    net = [float(b.sum()) - one.form.freedom for b, (one, _) in zip(blocks, told, strict=True)]
    best = blocks[int(np.argmax(net))]
    slack = FORM_TOLERANCE**2 * float(best.sum())
    equal = [
        pair
        for pair, b in zip(told, blocks, strict=True)
        if float((best - b).sum()) <= slack or reached(best - b) > WORSE
    ]
    least = min(one.form.freedom for one, _ in equal)
    # What takes more to say the same is no rival.
    kept = [pair for pair in equal if pair[0].form.freedom <= least + 1]
    return kept if len(kept) <= MOST_TOLD else []
