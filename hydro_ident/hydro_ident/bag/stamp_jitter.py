"""Whether stamps that jitter are the times of the readings, or only those of their messages.

A loop timed by software reads its sensors when it comes to run: the stamps are right, and readings
taken for even ones are off by speed times jitter. A device that samples evenly and whose messages
are stamped as they arrive is off by that once the stamps are believed. Differences from cycle to
cycle tell which: of what speed times jitter leaves in them, readings taken at their stamps hold
all, evenly sampled ones nothing. A rate that wanders from quarter second to quarter second is no
message's delay: those are the times of a simulator with steps of its own, or of a loop that slips.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.changes import sensor_columns
from hydro_ident.bag.recorded_run import Recording
from hydro_model.arrays import BoolArray, FloatArray, IntArray

#: Order of the differences: of a motion of 2 Hz they leave 1/4000 at 100 samples a second.
_ORDER = 4
#: A speed is the slope over two cycles to either side: a stencil and its speeds are so many rows.
_HALF = 2
_ROWS = _ORDER + 1 + 2 * _HALF
#: What the differences of white noise have of its standard deviation.
_GAIN = math.sqrt(math.comb(2 * _ORDER, _ORDER))
#: Below this share of the period (rms) jitter does nothing that a fit would see.
_EVEN = 0.005
#: Across a longer interval, in periods, cycles are missing.
_MISSING = 1.5
#: Standard deviations of a share that decide; differences overlap, so that of N only a third tell.
_CLEAR, _OVERLAP = 5.0, 3.0
_FEWEST = 200
#: A rate is that over so many cycles, of which bounded jitter is a percent at most; it wanders
#: where over this share of them it is further from the usual one than this.
_SPAN, _OFTEN, _ASTRAY = 25, 0.3, 0.03


@dataclass(slots=True)
class StampJitter:
    """How much stamps jitter, and whether the readings do, of cycles stretch by stretch.

    Parameters
    ----------
    period_s : float
    """

    period_s: float
    _rows: list[tuple[IntArray, FloatArray]] = field(default_factory=list)
    #: Stamps of a span under way, spans without a missing cycle, and those whose rate is another.
    _under_way: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    _spans: int = 0
    _astray: int = 0
    _count: int = 0
    _squares: float = 0.0
    #: By column: products of what jitter would leave, of it with what is there, and of that.
    _sums: FloatArray = field(default_factory=lambda: np.zeros((4, 0)))

    def add(self, recording: Recording) -> None:
        """Take in the next cycles."""
        self._follow(recording.stamp_ns)
        values = np.concatenate(list(sensor_columns(recording)), axis=1)
        self._rows.append((recording.stamp_ns, values))
        stamps = np.concatenate([one for one, _ in self._rows])
        values = np.concatenate([one for _, one in self._rows])
        self._rows = [(stamps[1 - _ROWS :], values[1 - _ROWS :])]
        if len(stamps) < _ROWS:
            return
        late = _lateness(stamps, self.period_s)
        bent = np.diff(late, _ORDER)[_HALF:-_HALF]
        known = _unbroken(stamps, self.period_s)
        self._count += int(known.sum())
        self._squares += float((bent[known] ** 2).sum()) / _GAIN**2
        if self._sums.shape[1] == 0:
            self._sums = np.zeros((4, values.shape[1]))
        if (bent[known] ** 2).sum() > (_EVEN * self.period_s * _GAIN) ** 2 * 0.1 * known.sum():
            self._compare(late, values, known)

    def _follow(self, stamp_ns: IntArray) -> None:
        stamps = np.concatenate([self._under_way, stamp_ns])
        whole = max(0, len(stamps) - 1) // _SPAN * _SPAN
        steps = np.diff(stamps[: whole + 1]).reshape(-1, _SPAN) / (self.period_s * 1e9)
        there = (steps <= _MISSING).all(axis=1)
        self._spans += int(there.sum())
        self._astray += int((np.abs(steps[there].mean(axis=1) - 1.0) > _ASTRAY).sum())
        self._under_way = stamps[whole:]

    def _compare(self, late: FloatArray, values: FloatArray, known: BoolArray) -> None:
        speed = (values[2 * _HALF :] - values[: -2 * _HALF]) / (2 * _HALF * self.period_s)
        late = late[_HALF:-_HALF, None]
        there = np.diff(values[_HALF:-_HALF], _ORDER, axis=0)
        # How late the cycle in the middle is moves all alike: it is no jitter.
        middle = late[_ORDER // 2 : -_ORDER // 2]
        left = np.diff(speed * late, _ORDER, axis=0) - middle * np.diff(speed, _ORDER, axis=0)
        told = known[:, None] & np.isfinite(left) & np.isfinite(there)
        left, there = np.where(told, left, 0.0), np.where(told, there, 0.0)
        products = left * left, left * there, there * there, told
        self._sums += np.array([one.sum(axis=0) for one in products])

    @property
    def rms_s(self) -> float:
        """How far stamps lie off an even grid."""
        return math.sqrt(self._squares / self._count) if self._count else 0.0

    @property
    def wanders(self) -> bool:
        """The rate is now this, now that."""
        return self._count >= _FEWEST and self._astray > _OFTEN * self._spans

    @property
    def uneven(self) -> bool:
        """Stamps jitter enough to ask."""
        return self.wanders or (self._count >= _FEWEST and self.rms_s > _EVEN * self.period_s)

    def share(self) -> tuple[float, float]:
        """How much of the stamps' jitter the readings have, and its standard deviation.

        1 where they were taken at their stamps, 0 where evenly; (0, inf) without a motion.
        """
        used = self._sums[:, self._sums[0] > 0.0]
        own, both, there, count = used
        rest = np.maximum(there - both**2 / own, 1e-12 * there) / np.maximum(count, 1.0)
        good = rest > 0.0
        weight = own[good] / rest[good]
        if not weight.size:
            return 0.0, math.inf
        total = float(weight.sum())
        mean = float((weight * both[good] / own[good]).sum()) / total
        return mean, math.sqrt(_OVERLAP / total)

    @property
    def of_readings(self) -> bool | None:
        """Whether readings were taken at their stamps; None where they do not tell.

        Above a share of a half they lie closer to their stamps than to an even grid.
        """
        if self.wanders or not self.uneven:
            return True if self.wanders else None
        share, std = self.share()
        return share > 0.5 if abs(share - 0.5) > _CLEAR * std else None

    @property
    def text(self) -> str:
        """In words."""
        period, rms = self.period_s * 1e3, self.rms_s * 1e3
        if self.wanders:
            return f"stamps are now closer, now further apart than {period:.4g} ms"
        return f"stamps lie {rms:.2g} ms (rms) off an even {period:.4g} ms"


def _lateness(stamp_ns: IntArray, period_s: float) -> FloatArray:
    """How much later each stamp is than at an even rate from the first, s."""
    return np.asarray((stamp_ns - stamp_ns[0]) * 1e-9 - period_s * np.arange(len(stamp_ns)))


def _unbroken(stamp_ns: IntArray, period_s: float) -> BoolArray:
    """Stencils in which no cycle is missing."""
    wide = np.diff(stamp_ns) > _MISSING * period_s * 1e9
    met = np.concatenate([[0], np.cumsum(wide)])
    return np.asarray(met[_ROWS - 1 :] == met[: 1 - _ROWS])
