"""Zero-phase low-pass filtering, differentiation and decimation of uniformly sampled arrays.

The paper filters the encoders at 5 Hz and differentiates them (its text after eq. 18). On this
class of crane 5 Hz sits on top of the hydraulic natural frequency (1.6-4.4 Hz), so the regressor
would lose what the regressand keeps. Here two filters are used:

* `differentiation_hz` only tames the second derivative of a quantised encoder. At 25 Hz and
  20 bit (3.5e-6 rad rms) it leaves about 0.012 rad/s^2, and changes a 5 Hz motion by less
  than 1e-5.
* `parallel_hz` limits the band that is fitted, and is applied to regressor and regressand alike
  after the regressor is formed, so that it cancels from the equation and cannot bias it. At 10 Hz
  the encoder's acceleration noise falls to about 1e-3 rad/s^2 (some 40 N at the piston).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.rails import between_readings
from hydro_ident.errors import IdentError
from hydro_model.robot import FloatArray

#: Samples that a central difference takes.
_POINTS = 5
#: Quickest differentiation as a share of the sampling rate.
QUICKEST = 0.4


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Cut-off frequencies of the inertial estimator.

    Attributes
    ----------
    differentiation_hz : float
        Applied to positions before they are differentiated, and to forces alike.
    parallel_hz : float
        Applied to regressor and regressand, before decimation.
    order : int
        Order of the Butterworth filter; the magnitude of the two passes is its square.
    keep_every : int
        Every how many filtered samples enter the fit; 0: two per period of `parallel_hz`, beyond
        which there is nothing new.
    """

    differentiation_hz: float = 25.0
    parallel_hz: float = 10.0
    order: int = 4
    keep_every: int = 0

    def __post_init__(self) -> None:
        for what, value in (
            ("differentiation", self.differentiation_hz),
            ("parallel", self.parallel_hz),
        ):
            if not value > 0.0:
                raise IdentError(f"expected a {what} cut-off above 0 Hz, found {value:g}")
        if self.order < 1:
            raise IdentError(f"expected a filter order of 1 or more, found {self.order}")
        if self.keep_every < 0:
            raise IdentError(
                f"expected a decimation of 1 or more (0: the default), found {self.keep_every}"
            )

    def borne_at(self, step_s: float) -> FilterSettings:
        """The filters as quick as so slow a recording bears them.

        Parameters
        ----------
        step_s : float
            Sampling interval.
        """
        quickest = QUICKEST / step_s
        if self.differentiation_hz <= quickest:
            return self
        slower = quickest / self.differentiation_hz
        return replace(self, differentiation_hz=quickest, parallel_hz=slower * self.parallel_hz)

    def edge_samples(self, step_s: float) -> int:
        """Samples to leave out at both ends of a segment: the filters settle to 1e-6 in them."""
        return 3 + math.ceil(6.0 / (self.parallel_hz * step_s))

    def decimation(self, step_s: float) -> int:
        """Every how many samples are kept."""
        if self.keep_every:
            return self.keep_every
        return self._resolved(step_s)

    def stride(self, step_s: float) -> int:
        """Kept samples that the parallel filter makes one of."""
        return max(1, round(self._resolved(step_s) / self.decimation(step_s)))

    def _resolved(self, step_s: float) -> int:
        return max(1, math.floor(1.0 / (2.0 * self.parallel_hz * step_s) + 1e-9))


def low_pass(data: FloatArray, step_s: float, cutoff_hz: float, order: int) -> FloatArray:
    """Butterworth low-pass filter run forwards and backwards along the first axis.

    Parameters
    ----------
    data : (N, ...) array
    step_s : float
        Sampling interval.
    cutoff_hz : float
    order : int
        Of one pass.

    Returns
    -------
    array
        Same shape, without phase lag.

    Raises
    ------
    IdentError
        The sampling rate is too low for the cut-off.
    """
    from hydro_ident.estimate.signals.filter_kernels import filter_both_ways

    if cutoff_hz * step_s >= 0.45:
        raise IdentError(
            f"a {cutoff_hz:g} Hz low-pass filter needs more than {cutoff_hz / 0.45:.0f} samples"
            f" per second, found {1.0 / step_s:.0f}"
        )
    count = data.shape[0]
    if not data.size:
        return np.array(data, dtype=float)
    sections, rest = _butterworth(order, cutoff_hz, step_s)
    padding = min(count - 1, math.ceil(2.0 / (cutoff_hz * step_s)))
    # Odd about both ends, as `scipy.signal.sosfiltfilt` has it.
    flat = np.asarray(data, dtype=float).reshape(count, -1)
    padded = np.empty((count + 2 * padding, flat.shape[1]))
    padded[padding : padding + count] = flat
    padded[:padding] = 2.0 * flat[0] - flat[padding:0:-1]
    padded[padding + count :] = 2.0 * flat[-1] - flat[-2 : -padding - 2 : -1]
    filter_both_ways(sections, rest, padded)
    return padded[padding : padding + count].reshape(data.shape)


@functools.lru_cache(maxsize=64)
def _butterworth(order: int, cutoff_hz: float, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Second-order sections and their state at rest: the same few are asked for again."""
    from scipy.signal import butter, sosfilt_zi

    sections = np.ascontiguousarray(butter(order, cutoff_hz, fs=1.0 / step_s, output="sos"))
    return sections, np.ascontiguousarray(sosfilt_zi(sections))


def central_differences(data: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """First and second derivative along the first axis by five-point central differences.

    The error is (2 pi f h)^4 / 30 of the first derivative: 8e-6 at 10 Hz and 500 samples a
    second, where the three-point formula of the paper errs by 3e-3.

    Parameters
    ----------
    data : (N, ...) array
        N >= 1. Of fewer than five samples, which no filter settles in, slopes are those from
        neighbour to neighbour, and bends 0.
    step_s : float

    Returns
    -------
    first, second : array
        Same shape; the two samples at either end repeat their inner neighbour.
    """
    if data.shape[0] < _POINTS:
        some = np.gradient(data, step_s, axis=0) if data.shape[0] > 1 else np.zeros_like(data)
        return np.asarray(some), np.zeros_like(some)
    far_low, low, mid, high, far_high = (
        data[k : data.shape[0] - _POINTS + 1 + k] for k in range(_POINTS)
    )
    first = (far_low - 8.0 * low + 8.0 * high - far_high) / (12.0 * step_s)
    second = (-far_low + 16.0 * low - 30.0 * mid + 16.0 * high - far_high) / (12.0 * step_s**2)
    pad = [(2, 2)] + [(0, 0)] * (data.ndim - 1)
    return np.pad(first, pad, mode="edge"), np.pad(second, pad, mode="edge")


def secant_slope(time_s: FloatArray, values: FloatArray, half_s: float = 0.01) -> FloatArray:
    """Slopes between samples `half_s` before and after, for looking at: nothing is fitted to them.

    Parameters
    ----------
    time_s : (N,) array
        Ascending; across a gap the slope is the mean over it.
    values : (N, ...) array
    half_s : float
        At least one sample.

    Returns
    -------
    (N, ...) array
        At the ends the nearest inner slope; NaN where there are too few samples.
    """
    if time_s.size < 3:
        return np.full(values.shape, np.nan)
    step_s = float(np.median(np.diff(time_s)))
    width = min(max(1, round(half_s / step_s)), (time_s.size - 1) // 2)
    span = time_s[2 * width :] - time_s[: -2 * width]
    inner = (values[2 * width :] - values[: -2 * width]) / span.reshape(
        -1, *[1] * (values.ndim - 1)
    )
    pad = [(width, width), *[(0, 0)] * (values.ndim - 1)]
    return np.asarray(np.pad(inner, pad, mode="edge"))


def motion(
    q: FloatArray, step_s: float, settings: FilterSettings
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Filtered positions of one contiguous segment with their derivatives.

    Parameters
    ----------
    q : (N, n) array
    step_s : float
    settings : FilterSettings

    Returns
    -------
    q, qd, qdd : (N, n) array
        `settings.edge_samples` at either end are not to be used. What stands still does so to the
        last bit: regression scales its columns, and rounding would be motion like any other.
    """
    smooth = low_pass(q, step_s, settings.differentiation_hz, settings.order)
    qd, qdd = central_differences(smooth, step_s)
    still = np.ptp(q, axis=0) == 0.0
    smooth[:, still] = q[:, still]
    qd[:, still] = qdd[:, still] = 0.0
    return smooth, qd, qdd


def smooth_rates(values: FloatArray, step_s: float, settings: FilterSettings) -> FloatArray:
    """Rates of pressures or forces (N, ...), as quick as forces are looked at; per second.

    Parameters
    ----------
    values : (N, ...) array
        Over what is not known they go straight from reading to reading: 0 there would be steps,
        whose rates the filter spreads over known samples. What never is known is 0.
    step_s : float
    settings : FilterSettings
    """
    if not np.isfinite(values).all():
        values = np.array(values, dtype=float)
        at = np.arange(len(values))
        # A view: what is filled in is filled in there.
        for own in values.reshape(len(values), -1).T:
            own[:] = between_readings(own, at) if np.isfinite(own).any() else 0.0
    smooth = low_pass(values, step_s, settings.differentiation_hz, settings.order)
    return central_differences(smooth, step_s)[0]


def parallel_filter(
    data: FloatArray,
    step_s: float,
    settings: FilterSettings,
    keep: NDArray[np.intp] | None = None,
) -> FloatArray:
    """Low-pass filter, trim the edges and decimate a column of the equation to be fitted.

    Parameters
    ----------
    data : (N, ...) array
        Regressor or regressand on one contiguous segment; both must come through here.
    step_s : float
    settings : FilterSettings
    keep : (M,) int array, optional
        Samples to keep; those of `kept_samples` by default.

    Returns
    -------
    (M, ...) array
        Empty where the segment is shorter than its two edges.
    """
    filtered = low_pass(data, step_s, settings.parallel_hz, settings.order)
    kept = kept_samples(data.shape[0], step_s, settings) if keep is None else keep
    return np.asarray(filtered[kept])


def kept_samples(
    count: int,
    step_s: float,
    settings: FilterSettings,
    cycle: int = 0,
    core: tuple[int, int] | None = None,
) -> NDArray[np.intp]:
    """Indices of a segment of `count` samples that `parallel_filter` keeps.

    Parameters
    ----------
    count : int
    step_s : float
    settings : FilterSettings
    cycle : int
        Number of the first sample in its recording: whole recordings and pieces of them keep
        the same samples.
    core : tuple of int, optional
        Samples that the segment owns, begin and end.
    """
    edge, every = settings.edge_samples(step_s), settings.decimation(step_s)
    begin, end = (0, count) if core is None else core
    begin, end = max(begin, edge), min(end, count - edge)
    return np.arange(begin + (edge - cycle - begin) % every, end, every, dtype=np.intp)
