"""Whitened regression against which candidates are held: what they gain beyond a refit.

Columns are compared after everything that the model fits anyway has been partialled out. For each
column its products with the residual are kept by block of time: flipping the signs of whole
blocks gives what such a column gains by chance, with the residual's own size and dependence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from hydro_ident.estimate.scoring.scores import in_turns
from hydro_ident.mismatch.fitting.limits import Limits, solved_within
from hydro_ident.mismatch.fitting.tall import factored
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.fitting.whitening_kernels import add_blocks, whiten
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.robot import FloatArray

#: Base columns within this share of each other's span count once.
RANK = 1.0e-9
#: Share of its noise that a block is taken to keep at least: what it alone tells leaves nothing.
_LEAST_KEPT = 1.0e-3


@dataclass(frozen=True, slots=True)
class Partial:
    """Candidate columns beyond the base.

    Attributes
    ----------
    gram : (k, k) array
        Products of the whitened columns among each other.
    scores : (B, k) array
        Their products with the residual by block of time.
    plain : (k,) array
        Squared norms before the base was partialled out.
    chance : (B, k) array
        As `scores`, with what is left of the residual without the best candidate.
    """

    gram: FloatArray
    scores: FloatArray
    plain: FloatArray
    chance: FloatArray


@dataclass(frozen=True, slots=True)
class Witness:
    """A residual, for products with columns beyond the base.

    Attributes
    ----------
    values : (M,) array
        Whitened.
    told : (B, r) array
        Its products with the base's directions by block of time.
    """

    values: FloatArray
    told: FloatArray


@dataclass(frozen=True, slots=True)
class _Span:
    """Rows of a channel: of the layout, and of the settled ones."""

    channel: int
    all: slice
    settled: slice


class Bench:
    """Whitened rows of a model.

    Parameters
    ----------
    layout : Layout
    noise : Noise
    y : (N,) array
        Residual, or measured values.
    x : (N, p) array
        All columns that a refit may move.
    block_s : float
        Length of a block of time.
    prior : ((m, p), (m,)) arrays, optional
        Further equations of unit variance, columns and values: what is known beforehand.
    mask : (M,) bool array, optional
        `y` and `x` have these rows, of which the layout's are those in it: whoever has more rows
        than are wanted leaves them out here, where nobody keeps the copy.
    """

    def __init__(
        self,
        layout: Layout,
        noise: Noise,
        y: FloatArray,
        x: FloatArray,
        block_s: float,
        prior: tuple[FloatArray, FloatArray] | None = None,
        mask: BoolArray | None = None,
    ) -> None:
        self.layout, self.noise = layout, noise
        self.rows = noise.settled(layout)
        self._y = noise.whitened(layout, y if mask is None else y[mask])[self.rows]
        scaled = noise.whitened(layout, x if mask is None else x[mask])[self.rows]
        self.measured = self._y.size
        block = layout.blocks(block_s)[self.rows]
        channel = layout.channel[self.rows]
        if prior is not None:
            self._y = np.concatenate([self._y, prior[1]])
            scaled = np.concatenate([scaled, prior[0]])
            last = int(block.max()) + 1 if block.size else 0
            block = np.concatenate([block, np.full(prior[1].size, last)])
            channel = np.concatenate([channel, np.full(prior[1].size, -1)])
        self.block: IndexArray = block
        self.channel: IndexArray = channel
        self.scale = np.linalg.norm(scaled, axis=0)
        self.scale[self.scale == 0.0] = 1.0
        # In place: of a long recording of many joints each copy is a tenth of a gigabyte.
        scaled /= self.scale
        self._scaled = scaled
        self.basis, self._r, self._pivot = factored(scaled, RANK)
        self.residual: FloatArray = self._y - self.basis @ (self.basis.T @ self._y)

    @cached_property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.block.max()) + 1 if self.block.size else 0

    @property
    def squares(self) -> float:
        """Sum of squares of the whitened values themselves."""
        return float(self._y @ self._y)

    @property
    def count(self) -> int:
        """Rows."""
        return int(self.residual.size)

    @property
    def rank(self) -> int:
        """Directions that the base fits."""
        return int(self.basis.shape[1])

    def solve(self, reach: FloatArray | None = None, limits: Limits | None = None) -> FloatArray:
        """Least-squares coefficients of the columns; zero where others say the same.

        Parameters
        ----------
        reach : (p,) array, optional
            Coefficients that cost as much as a deviation of the noise, infinite where they cost
            nothing: what the rows tell stays as it is, and what they do not tell stays small.
        limits : Limits, optional
            Between which coefficients lie: the others follow how far those at a limit really go.
        """
        theta, rows, wanted = np.zeros(self.scale.size), self._r, self.basis.T @ self._y
        if reach is not None:
            cost = np.diag(1.0 / (reach * self.scale)[self._pivot])
            rows = np.concatenate([rows, cost])
            wanted = np.concatenate([wanted, np.zeros(self.rank)])
        if limits is None:
            theta[self._pivot] = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        else:
            ends = [(end * self.scale)[self._pivot] for end in (limits.lower, limits.upper)]
            theta[self._pivot] = solved_within(rows, wanted, Limits(*ends))
        return np.asarray(theta / self.scale)

    def taken_out(self, theta: FloatArray) -> float:
        """What coefficients of the columns take out of the sum of squares.

        Parameters
        ----------
        theta : (p,) array
            As `solve` returns them.
        """
        wanted = self.basis.T @ self._y
        left = wanted - self._r @ (theta * self.scale)[self._pivot]
        return float(wanted @ wanted - left @ left)

    def refit(self, column: FloatArray) -> FloatArray:
        """Coefficients of the columns that come closest to another column (N,)."""
        theta = np.zeros(self.scale.size)
        theta[self._pivot] = np.linalg.solve(self._r, self.basis.T @ self._whitened(column))
        return np.asarray(theta / self.scale)

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the coefficients, robust against what is left of dependence in blocks.

        Residuals are smaller than the noise, the more so in blocks that weigh more. The scores of
        a block are freed of that by its leverage (CR2, Bell and McCaffrey 2002).
        """
        inverse = np.zeros((self.scale.size, self.rank))
        inverse[self._pivot] = np.linalg.inv(self._r)
        scores = self._unshrunk(self.by_block(self.basis, self.residual))
        meat = scores.T @ scores
        # Never below what independent rows would give.
        meat = np.where(np.eye(self.rank) > 0.0, np.maximum(meat, np.eye(self.rank)), meat)
        total = inverse @ meat @ inverse.T
        return np.asarray(total / np.outer(self.scale, self.scale))

    def _unshrunk(self, scores: FloatArray) -> FloatArray:
        """Scores (B, r) of blocks as those of noise that no fit has seen.

        Of white noise the rows of a block keep ``1 - Q Q'`` of their covariance, so that its
        scores ``Q' e`` are to be multiplied by ``(1 - Q' Q)^(-1/2)``.
        """
        result, order = scores.copy(), np.argsort(self.block[: self.measured], kind="stable")
        ends = np.searchsorted(self.block[order], np.arange(self.blocks + 1))
        for k in range(self.blocks):
            # What is known beforehand is no block of noise: it has no measured rows.
            own = self.basis[order[ends[k] : ends[k + 1]]]
            if own.size:
                shares, axes = np.linalg.eigh(own.T @ own)
                kept = np.maximum(1.0 - shares, _LEAST_KEPT)
                result[k] = axes @ ((axes.T @ scores[k]) / np.sqrt(kept))
        return result

    def beyond(self, columns: FloatArray) -> FloatArray:
        """Whitened columns (N, k) with the base partialled out."""
        white = self._whitened(columns)
        return np.asarray(white - self.basis @ (self.basis.T @ white))

    def partial(
        self,
        columns: FloatArray,
        left_over: Witness | None = None,
        rows: BoolArray | None = None,
    ) -> Partial:
        """What columns hold beyond the base, and what of the residual they meet.

        What a column c lacks of the base's directions Q is not laid out over all rows: by
        ``(c - Q Q'c)'(c - Q Q'c) = c'c - (Q'c)'(Q'c)`` and, of a block b with a residual e,
        ``e_b'(c - Q Q'c)_b = e_b'c_b - (e_b'Q_b) Q'c`` only rows on which it acts are touched.

        Parameters
        ----------
        columns : (N, k) array
        left_over : Witness, optional
            Another residual whose products with the columns are wanted, too.
        rows : (N,) bool array, optional
            Whole channels that the columns are of, M of the rows, where they are (M, k) of these.
        """
        count = columns.shape[1]
        gram, plain, told = np.zeros((count, count)), np.zeros(count), np.zeros((self.rank, count))
        witnesses = [self._own, *([] if left_over is None else [left_over])]
        sums = [np.zeros((self.blocks, count)) for _ in witnesses]
        for span, columns_of in self._acting(columns, rows):
            kept, white = span.settled, self._white(span, columns_of)
            gram += white.T @ white
            plain += np.sum(white**2, axis=0)
            told += self.basis[kept].T @ white
            for out, one in zip(sums, witnesses, strict=True):
                add_blocks(self.block[kept], white, one.values[kept], out)
        beyond = [out - one.told @ told for out, one in zip(sums, witnesses, strict=True)]
        return Partial(gram - told.T @ told, beyond[0], plain, beyond[-1])

    def witness(self, values: FloatArray) -> Witness:
        """Whitened values (M,) laid out for products with what columns hold beyond the base."""
        return Witness(values, self.by_block(self.basis, values))

    @cached_property
    def _own(self) -> Witness:
        return self.witness(self.residual)

    @cached_property
    def _spans(self) -> tuple[_Span, ...]:
        """Of every channel."""
        numbers = np.arange(len(self.noise.phi) + 1)
        ends = np.searchsorted(self.layout.channel, numbers)
        settled = np.append(0, np.cumsum(self.rows))[ends]
        return tuple(
            _Span(k, slice(*ends[k : k + 2].tolist()), slice(*settled[k : k + 2].tolist()))
            for k in range(len(self.noise.phi))
        )

    def _acting(
        self, columns: FloatArray, rows: BoolArray | None
    ) -> Iterator[tuple[_Span, FloatArray]]:
        """Channels on which columns act, with their rows of these."""
        at = 0
        for span in self._spans:
            size = span.all.stop - span.all.start
            if rows is None:
                own = columns[span.all]
            elif size and rows[span.all.start]:
                own = columns[at : at + size]
                at += size
            else:
                continue
            if own.any():
                yield span, own

    def _white(self, span: _Span, columns: FloatArray) -> FloatArray:
        """A channel's rows of columns, whitened, the settled ones."""
        white = np.array(columns, dtype=float, order="C")
        noise, k = self.noise, span.channel
        whiten(white, 0, len(white), noise.phi[k], float(noise.std[k]))
        return white[self.rows[span.all]]

    def held_out(
        self, block_s: float, folds: int, guard_s: float, reach: FloatArray | None = None
    ) -> FloatArray:
        """Twice the negative log-likelihood of rows that took no part, by folds; (folds,).

        The rows of a fold are predicted together, and no better than the other folds know the
        coefficients (Gaussian, of covariance I + H by the leverages H): where a fold holds all
        that tells one of them, its rows are no evidence against it. A constant is left out.

        Parameters
        ----------
        block_s : float
            Length of a block.
        folds : int
        guard_s : float
            What is left out around held-out blocks.
        reach : (p,) array, optional
            As `solve`: a shape that a fold's rows do not tell stays where all rows have it.
        """
        times, recording = self.layout.time_s[self.rows], self.layout.recording[self.rows]
        x, y, extra = self._scaled, self._y, slice(self.measured, None)
        stays = np.zeros(x.shape[1]) if reach is None else (reach * self.scale) ** -2.0
        result = np.zeros(folds)
        number = [
            (in_turns(np.floor((times + shift) / block_s).astype(int), folds) + recording) % folds
            for shift in (-guard_s, 0.0, guard_s)
        ]
        for fold in range(folds):
            held = number[1] == fold
            kept = ~(held | (number[0] == fold) | (number[2] == fold))
            a = np.concatenate([x[: self.measured][kept], x[extra]])
            b = np.concatenate([y[: self.measured][kept], y[extra]])
            gram = a.T @ a
            known = gram + np.diag(RANK * np.trace(gram) + stays)
            root = np.linalg.cholesky(known)
            half = solve_triangular(root, a.T @ b, lower=True)
            lever = solve_triangular(root, x[: self.measured][held].T, lower=True)
            left = y[: self.measured][held] - lever.T @ half
            # Woodbury's identity: as many equations as coefficients, not as rows.
            wide = np.linalg.cholesky(np.eye(x.shape[1]) + lever @ lever.T)
            common = solve_triangular(wide, lever @ left, lower=True)
            result[fold] = left @ left - common @ common + 2.0 * np.sum(np.log(np.diag(wide)))
        return result

    def _whitened(self, columns: FloatArray) -> FloatArray:
        white = self.noise.whitened(self.layout, columns)[self.rows]
        extra = self._y.size - self.measured
        return np.concatenate([white, np.zeros((extra, *white.shape[1:]))]) if extra else white

    def spread(self, column: FloatArray, together: int = 1) -> float:
        """How many blocks, or so many together, of equal weight a whitened column (M,) is worth.

        What lives in a few blocks only is one event or two: no flips of so few signs are rare.
        """
        block = self.block[: self.measured] // together
        energy = np.bincount(block, weights=column[: self.measured] ** 2)
        squares = float(np.sum(energy**2))
        return float(np.sum(energy)) ** 2 / squares if squares > 0.0 else 0.0

    def by_block(self, values: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """Sums (B, k) of rows by block of time; `weights` (N,) are what each row counts."""
        result = np.zeros((self.blocks, values.shape[1]))
        weights = np.ones(len(values)) if weights is None else weights
        add_blocks(self.block, np.ascontiguousarray(values), weights, result)
        return result
