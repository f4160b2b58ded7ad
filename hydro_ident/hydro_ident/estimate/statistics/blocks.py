"""Moments of all recordings and channels, as the solvers take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.statistics.moments import Moments
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Blocks:
    """Moments of all recordings and channels, with regressors combined as wanted.

    Attributes
    ----------
    x : (G, m, L, p) array
        Regressors by group (recording and channel), row of the factor, and lag.
    y : (G, m, L) array
    z : (G, m, L, p) array or None
        Instruments: as gathered, or combined of the regressors that were.
    channel : (G,) int array
    count : (G,) array
        Rows behind each group.
    effective : (G,) array
        The same, or the sum of their robust weights.
    labels : tuple of str
        Recording of each group.
    far : (G, nodes, p, p) array
        Sums of products of regressors by lag (`hydro_ident.estimate.statistics.lag_sums`).
    far_z : (G, nodes, p, p) array or None
        The same of the instruments.
    stride : int
        Rows that count as one.
    columns : (p,) int array or None
        Which of the gathered columns these are, where some are held.
    own_x : (G, r, p) array or None
        Regressors under robust weights, from which the parameters come.
    own_y : (G, r) array or None
    own_z : (G, r, p) array or None
        Instruments under robust weights.
    sample_s : (G,) array or None
        Sampling interval behind each group; None: all have the same.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray | None
    channel: NDArray[np.intp]
    count: FloatArray
    effective: FloatArray
    labels: tuple[str, ...]
    far: FloatArray
    far_z: FloatArray | None = None
    stride: int = 1
    columns: NDArray[np.intp] | None = None
    own_x: FloatArray | None = None
    own_y: FloatArray | None = None
    own_z: FloatArray | None = None
    sample_s: FloatArray | None = None

    @property
    def channels(self) -> int:
        """Number of channels."""
        return int(self.channel.max()) + 1

    @property
    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Regressors (G, r, p) and y (G, r) that the parameters come from."""
        if self.own_x is None or self.own_y is None:
            return self.x[:, :, 0], self.y[:, :, 0]
        return self.own_x, self.own_y

    @property
    def instruments(self) -> FloatArray | None:
        """Instruments (G, r, p) in the rows that the parameters come from."""
        if self.own_x is None:
            return None if self.z is None else self.z[:, :, 0]
        return self.own_z

    def held(self, free: NDArray[np.intp], shift: FloatArray) -> Blocks:
        """The free columns alone, what values (p,) of the others give taken off y.

        `shift` (p,) are those values, 0 for free columns.
        """
        z = None if self.z is None else self.z[..., free]
        x, y = self.x[..., free], self.y - self.x @ shift
        square = np.ix_(free, free)
        far = self.far[..., square[0], square[1]]
        far_z = None if self.far_z is None else self.far_z[..., square[0], square[1]]
        part = replace(self, x=x, y=y, z=z, far=far, far_z=far_z, columns=free)
        if self.own_x is None or self.own_y is None:
            return part
        own_x, own_y = self.own_x[..., free], self.own_y - self.own_x @ shift
        own_z = None if self.own_z is None else self.own_z[..., free]
        return replace(part, own_x=own_x, own_y=own_y, own_z=own_z)


def blocks_of(
    moments: Sequence[Moments],
    combines: Sequence[FloatArray] | None = None,
    instruments: Sequence[FloatArray] | None = None,
    noise: bool = True,
) -> Blocks:
    """Arrange moments for a fit; groups without rows are left out.

    Parameters
    ----------
    moments : sequence of Moments
        One per recording, of the same channels.
    combines : sequence of (w, p) array, optional
        Regressors as combinations of those gathered, by recording.
    instruments : sequence of (w, p) array, optional
        Instruments as combinations of the same, where moments without instruments hold them.
    noise : bool
        With the lags and sums that a noise model needs; parameters alone need none of them.
    """
    chosen = [
        (i, k) for i, m in enumerate(moments) for k in range(m.channels) if m.lagged[k] > 0.0
    ]
    channel = [k for _, k in chosen]
    count, effective = (
        np.array([getattr(moments[i], name)[k] for i, k in chosen])
        for name in ("lagged", "effective")
    )
    labels = [moments[i].label for i, _ in chosen]
    by_group, z_group = (
        None if given is None else [given[i] for i, _ in chosen]
        for given in (combines, instruments)
    )
    first = moments[0]
    lags, width = first.lags + 1, first.width
    stacked = [moments[i].factor[k].reshape(-1, lags, moments[i].width) for i, k in chosen]
    stacked = stacked if noise else [one[:, :1] for one in stacked]
    half = (width - 1) // 2 if first.instruments else 0
    z = np.array([one[..., :half] for one in stacked]) if first.instruments else None
    x, y = _split(stacked, half, by_group)
    found = [(moments[i].own, k) for i, k in chosen]
    own = [one[k] for one, k in found if one is not None]
    own_x, own_y = _split(own, half, by_group) if own else (None, None)
    own_z = _split(own, half, z_group)[0] if own and z_group is not None else None
    if z_group is not None:
        z = _split(stacked, half, z_group)[0]
    if by_group is not None:
        x, y, z = _shortened(x, y, z)
    far: tuple[FloatArray, FloatArray | None] = np.zeros((len(x), 0, *x.shape[3:] * 2)), None
    if noise:
        far = _sums_by_lag(moments, chosen, by_group, z_group)
    return Blocks(
        x,
        y,
        z,
        np.array(channel, dtype=np.intp),
        count,
        effective,
        tuple(labels),
        *far,
        first.stride,
        own_x=own_x,
        own_y=own_y,
        own_z=own_z,
        sample_s=np.array([moments[i].sample_s for i, _ in chosen]),
    )


def _sums_by_lag(
    moments: Sequence[Moments],
    chosen: Sequence[tuple[int, int]],
    combines: Sequence[FloatArray] | None,
    instruments: Sequence[FloatArray] | None,
) -> tuple[FloatArray, FloatArray | None]:
    """Of the regressors of each group and of their instruments, where there are any."""
    totals = [m.far.total for m in moments]
    gathered = [totals[i][k] for i, k in chosen]
    far, far_z = gathered, None
    if moments[0].far_z is not None:
        totals_z = [m.far_z.total for m in moments if m.far_z is not None]
        far_z = np.array([totals_z[i][k] for i, k in chosen])
    if instruments is not None:
        far_z = np.array([c.T @ part @ c for part, c in zip(gathered, instruments, strict=True)])
    if combines is not None:
        far = [c.T @ part @ c for part, c in zip(gathered, combines, strict=True)]
    return np.array(far), far_z


def _split(
    groups: Sequence[FloatArray], half: int, combines: Sequence[FloatArray] | None
) -> tuple[FloatArray, FloatArray]:
    """Regressors and y of factors of several groups; shorter ones end in rows of zeros."""
    x, y = [one[..., half:-1] for one in groups], [one[..., -1] for one in groups]
    if combines is not None:
        x = [part @ combine for part, combine in zip(x, combines, strict=True)]
    rows = max(len(part) for part in x)
    return _padded(x, rows), _padded(y, rows)


def _padded(parts: Sequence[FloatArray], rows: int) -> FloatArray:
    return np.array(
        [np.pad(p, [(0, rows - len(p)), *((0, 0) for _ in p.shape[1:])]) for p in parts]
    )


def _shortened(
    x: FloatArray, y: FloatArray, z: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """The same products from fewer rows: as many as there are columns."""
    both = np.concatenate([x, y[..., None], *([] if z is None else [z])], axis=3)
    groups, rows, lags, width = both.shape
    if rows <= lags * width:
        return x, y, z
    factor = np.asarray(np.linalg.qr(both.reshape(groups, rows, lags * width), mode="r"))
    short, size = factor.reshape(groups, -1, lags, width), x.shape[3]
    return short[..., :size], short[..., size], None if z is None else short[..., size + 1 :]


def unit_columns(blocks: Blocks) -> tuple[Blocks, FloatArray]:
    """The same with columns of unit length, and their lengths."""
    norms = np.sqrt(np.sum(blocks.x[:, :, 0] ** 2, axis=(0, 1)))
    norms = np.where(norms > 0.0, norms, 1.0)
    z = None if blocks.z is None else blocks.z / norms
    square = np.outer(norms, norms)
    far_z = None if blocks.far_z is None else blocks.far_z / square
    own_x = None if blocks.own_x is None else blocks.own_x / norms
    own_z = None if blocks.own_z is None else blocks.own_z / norms
    part = replace(blocks, x=blocks.x / norms, z=z, far=blocks.far / square, far_z=far_z)
    return replace(part, own_x=own_x, own_z=own_z), norms
