"""Moments of all recordings and channels, as the solvers take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.moments import Moments
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
        Instruments.
    channel : (G,) int array
    count : (G,) array
        Rows behind each group.
    labels : tuple of str
        Recording of each group.
    far : (G, nodes, p, p) array
        Sums of products of regressors by lag (`hydro_ident.estimate.lag_sums`).
    far_z : (G, nodes, p, p) array or None
        The same of the instruments.
    stride : int
        Rows that count as one.
    columns : (p,) int array or None
        Which of the gathered columns these are, where some are held.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray | None
    channel: NDArray[np.intp]
    count: FloatArray
    labels: tuple[str, ...]
    far: FloatArray
    far_z: FloatArray | None = None
    stride: int = 1
    columns: NDArray[np.intp] | None = None

    @property
    def channels(self) -> int:
        """Number of channels."""
        return int(self.channel.max()) + 1

    def held(self, free: NDArray[np.intp], shift: FloatArray) -> Blocks:
        """The free columns alone, what values (p,) of the others give taken off y."""
        z = None if self.z is None else self.z[..., free]
        x, y = self.x[..., free], self.y - self.x @ shift
        square = np.ix_(free, free)
        far = self.far[..., square[0], square[1]]
        far_z = None if self.far_z is None else self.far_z[..., square[0], square[1]]
        return replace(self, x=x, y=y, z=z, far=far, far_z=far_z, columns=free)


def blocks_of(
    moments: Sequence[Moments],
    combines: Sequence[FloatArray] | None = None,
) -> Blocks:
    """Arrange moments for a fit; groups without rows are left out.

    Parameters
    ----------
    moments : sequence of Moments
        One per recording, of the same channels.
    combines : sequence of (w, p) array, optional
        Regressors as combinations of those gathered, by recording.
    """
    chosen = [
        (i, k) for i, m in enumerate(moments) for k in range(m.channels) if m.lagged[k] > 0.0
    ]
    channel = [k for _, k in chosen]
    count = [moments[i].lagged[k] for i, k in chosen]
    labels = [moments[i].label for i, _ in chosen]
    first = moments[0]
    lags, width = first.lags + 1, first.width
    factors = np.array([moments[i].factor[k] for i, k in chosen])
    stacked = factors.reshape(-1, lags * width, lags, width)
    half = (width - 1) // 2 if first.instruments else 0
    z = stacked[..., :half] if first.instruments else None
    x, y = stacked[..., half:-1], stacked[..., -1]
    far = np.array([moments[i].far.total[k] for i, k in chosen])
    sums_z = [(moments[i].far_z, k) for i, k in chosen]
    far_z = np.array([one.total[k] for one, k in sums_z if one is not None])
    if combines is not None:
        by_group = [combines[i] for i, _ in chosen]
        x = np.stack([part @ combine for part, combine in zip(x, by_group, strict=True)])
        far = np.stack([c.T @ part @ c for part, c in zip(far, by_group, strict=True)])
        x, y = _shortened(x, y)
    return Blocks(
        x,
        y,
        z,
        np.array(channel, dtype=np.intp),
        np.array(count),
        tuple(labels),
        far,
        far_z if far_z.size else None,
        first.stride,
    )


def _shortened(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same products from fewer rows: as many as there are columns."""
    both = np.concatenate([x, y[..., None]], axis=3)
    groups, rows, lags, width = both.shape
    if rows <= lags * width:
        return x, y
    factor = np.asarray(np.linalg.qr(both.reshape(groups, rows, lags * width), mode="r"))
    short = factor.reshape(groups, -1, lags, width)
    return short[..., :-1], short[..., -1]


def unit_columns(blocks: Blocks) -> tuple[Blocks, FloatArray]:
    """The same with columns of unit length, and their lengths."""
    norms = np.sqrt(np.sum(blocks.x[:, :, 0] ** 2, axis=(0, 1)))
    norms = np.where(norms > 0.0, norms, 1.0)
    z = None if blocks.z is None else blocks.z / norms
    square = np.outer(norms, norms)
    far_z = None if blocks.far_z is None else blocks.far_z / square
    return replace(blocks, x=blocks.x / norms, z=z, far=blocks.far / square, far_z=far_z), norms
