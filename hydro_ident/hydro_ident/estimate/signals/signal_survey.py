"""What a first look at recordings tells: ranges, means and the sensors' noise, in flat memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.estimate.signals.spikes import SHORTEST, spike_sizes
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.histogram import Histogram
from hydro_model.hydraulics.cylinder import chamber_volumes, lever
from hydro_model.robot import FloatArray, Robot

#: Share of normal noise within a standard deviation.
_ONE_SIGMA = 0.6827
#: Differences that tell noise from motion, by their order: what they leave of a motion shrinks
#: from one to the next beside what they leave of white noise.
_ORDERS = (3, 4, 5, 6)
#: In quicker recordings third differences do: beside white noise they leave 1/1160 of a motion of
#: 5 Hz at 200 samples a second, a nineteenth at 50, where sixth ones leave 1/545.
_QUICK_S = 0.0055
#: The third difference of white noise has 1 + 9 + 9 + 1 times its variance.
_THIRD = math.sqrt(20.0)
#: Time before and after a position over which it is seen to bend, s, as a crane's accelerations
#: are slower; and the share of these sizes that the largest does not pass, as outliers do.
_BENDS_S, _LARGEST = 0.05, 0.99
#: A reading's usual size: few outliers are among the readings below it.
_USUAL = 0.95


@dataclass(slots=True)
class Sensor:
    """One sensor over all that was looked at.

    Attributes
    ----------
    differences : list of Histogram
        By `_ORDERS`: sizes of differences, white noise's as large as of third ones; of quick
        recordings those of third ones in each. A crane's motion vanishes in them.
    deviations : Histogram
        How far samples lie from where their neighbours put them (`spike_sizes`).
    sizes : Histogram
        Of the readings.
    total, count : float
        For the mean.
    smallest_step : float
        Smallest change from one sample to the next that is one; infinite where there was none.
    lone : bool
        Deviations as of `spike_sizes`; the noise is then not white, and theirs if that is more.
    """

    differences: list[Histogram] = field(default_factory=lambda: [Histogram() for _ in _ORDERS])
    deviations: Histogram = field(default_factory=Histogram)
    sizes: Histogram = field(default_factory=Histogram)
    total: float = 0.0
    count: int = 0
    smallest_step: float = math.inf
    lone: bool = False

    def add(self, values: FloatArray, own: slice, step_s: float) -> None:
        """Take in the samples of a trace of which `own` are new, stretch by stretch.

        Parameters
        ----------
        values : (N,) array
        own : slice
        step_s : float
            Sampling interval.
        """
        for begin, end in runs(np.isfinite(values)):
            first, last = max(own.start, begin), min(own.stop, end)
            if end - begin >= SHORTEST and first < last:
                self._add_run(values[begin:end], slice(first - begin, last - begin), step_s)

    def _add_run(self, values: FloatArray, own: slice, step_s: float) -> None:
        quick = step_s < _QUICK_S
        found = [_differences(values, order)[own] for order in _ORDERS[: 1 if quick else None]]
        for k, histogram in enumerate(self.differences):
            histogram.add(found[0 if quick else k])
        self.deviations.add(spike_sizes(values, self.lone)[own])
        self.sizes.add(np.abs(values[own]))
        change = np.abs(np.diff(values))[own.start : own.stop]
        self.smallest_step = float(np.min(change[change > 0.0], initial=self.smallest_step))
        self.total += float(values[own].sum())
        self.count += values[own].size

    def merge(self, other: Sensor) -> None:
        """Take in what another look found."""
        for own, more in zip(self.differences, other.differences, strict=True):
            own.merge(more)
        self.deviations.merge(other.deviations)
        self.sizes.merge(other.sizes)
        self.smallest_step = min(self.smallest_step, other.smallest_step)
        self.total += other.total
        self.count += other.count

    @property
    def mean(self) -> float:
        """Mean reading."""
        return self.total / max(self.count, 1)

    @property
    def smallest_change(self) -> float:
        """The resolution as far as it was seen; 0 where the reading never changed."""
        return self.smallest_step if math.isfinite(self.smallest_step) else 0.0

    def step(self, declared: float) -> float:
        """The step between readings: a log may have been rounded behind its sensor.

        Of a reading that stands still nearly all the time the least change is an event's, no step.

        Parameters
        ----------
        declared : float
            The sensor's own.
        """
        changes = self.differences[0].quantile(_LARGEST) > 0.0
        return max(declared, self.smallest_change) if changes else declared

    @property
    def usual_size(self) -> float:
        """Size that 95 % of the readings do not pass."""
        return self.sizes.quantile(_USUAL)

    def noise(self, resolution: float) -> float:
        """Standard deviation of the white noise; a sensor at rest still has its rounding.

        The 68th percentile keeps shocks out, and the order in which least is left the motion.

        `resolution` is the step between values, in the sensor's unit.
        """
        spread = min(sizes.quantile(_ONE_SIGMA) for sizes in self.differences) / _THIRD
        if self.lone:
            spread = max(spread, self.deviations.quantile(_ONE_SIGMA))
        return max(spread, resolution / math.sqrt(12.0))


def _differences(values: FloatArray, order: int) -> FloatArray:
    """Sizes of differences from each sample on, white noise's as large as of third ones."""
    # The n-th difference of white noise has (2n over n) times its variance.
    gain = math.sqrt(math.comb(2 * order, order)) / _THIRD
    return np.asarray(np.abs(np.diff(values, order)) / gain)


@dataclass(slots=True)
class SignalSurvey:
    """Ranges, means and noise of every signal.

    Attributes
    ----------
    robot : Robot
    q, effort : list of Sensor
        By joint; efforts where no pressures give the force.
    p_a, p_b, stroke : list of Sensor
        By cylinder; strokes where the joint's angle is unknown.
    supply, tank : Sensor
    low, high : (n,) array
        Range of the joints.
    bends : list of Histogram
        By joint, sizes of second differences of the positions over 50 ms: an accelerated joint has
        them, one that drifts has those of its encoder's noise.
    arm : (m,) array
        Sum of the levers' sizes.
    volume : (m, 2) array
        Sum of the chambers' volumes.
    samples : (m,) array
        Behind `arm` and `volume`.
    shortest, longest : (m, 2) array
        Range of the strokes while chambers a and b were read; infinite where they never were.
    curves : (n, 2) array
        Of joints' accelerations over some hundredths of a second: sum of squares, and what noise
        of 1 (rad or m) adds to it.
    curved : float
        How many.
    seconds : dict of float to float
        Recorded time by sampling interval.
    """

    robot: Robot
    q: list[Sensor] = field(init=False)
    p_a: list[Sensor] = field(init=False)
    p_b: list[Sensor] = field(init=False)
    effort: list[Sensor] = field(init=False)
    stroke: list[Sensor] = field(init=False)
    supply: Sensor = field(default_factory=Sensor)
    tank: Sensor = field(default_factory=Sensor)
    low: FloatArray = field(init=False)
    high: FloatArray = field(init=False)
    bends: list[Histogram] = field(init=False)
    arm: FloatArray = field(init=False)
    volume: FloatArray = field(init=False)
    samples: FloatArray = field(init=False)
    shortest: FloatArray = field(init=False)
    longest: FloatArray = field(init=False)
    curves: FloatArray = field(init=False)
    curved: float = 0.0
    seconds: dict[float, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        dof, cylinders = self.robot.dof, len(self.robot.cylinders)
        self.q = [Sensor() for _ in range(dof)]
        self.effort = [Sensor(lone=True) for _ in range(dof)]
        self.bends = [Histogram() for _ in range(dof)]
        self.p_a, self.p_b, self.stroke = ([Sensor() for _ in range(cylinders)] for _ in range(3))
        self.low, self.high = np.full(dof, np.inf), np.full(dof, -np.inf)
        self.arm, self.samples = np.zeros(cylinders), np.zeros(cylinders)
        self.volume, self.curves = np.zeros((cylinders, 2)), np.zeros((dof, 2))
        self.shortest, self.longest = (np.full((cylinders, 2), b) for b in (np.inf, -np.inf))

    @staticmethod
    def of(robot: Robot, traces: Iterable[Trace]) -> SignalSurvey:
        """Survey of some traces."""
        survey = SignalSurvey(robot)
        for trace in traces:
            survey.add(trace)
        return survey

    def add(self, trace: Trace) -> None:
        """Take in the samples that a trace owns."""
        own = trace.owned
        self._add_time(trace.step_s, (own.stop - own.start) * trace.step_s)
        for sensors, values in ((self.q, trace.q), (self.p_a, trace.p_a), (self.p_b, trace.p_b)):
            for i, sensor in enumerate(sensors):
                sensor.add(values[:, i], own, trace.step_s)
        self._add_others(trace)
        self._add_bends(trace)
        if np.isfinite(trace.q).all():
            self.low = np.minimum(self.low, trace.q[own].min(axis=0))
            self.high = np.maximum(self.high, trace.q[own].max(axis=0))
        for i, cylinder in enumerate(self.robot.cylinders):
            strokes = trace.stroke[own, i]
            known = np.isfinite(strokes)
            q = trace.q[own, self.robot.joint_index(cylinder.joint)]
            self.arm[i] += float(np.nansum(np.abs(lever(cylinder, q))))
            volumes = chamber_volumes(cylinder, strokes[known])
            self.volume[i] += [float(v.sum()) for v in volumes]
            self.samples[i] += float(known.sum())
            for side, pressure in enumerate((trace.p_a[own, i], trace.p_b[own, i])):
                seen = strokes[known & np.isfinite(pressure)]
                self.shortest[i, side] = np.min(seen, initial=self.shortest[i, side])
                self.longest[i, side] = np.max(seen, initial=self.longest[i, side])

    def _add_bends(self, trace: Trace) -> None:
        span = max(1, round(_BENDS_S / trace.step_s))
        own = slice(trace.owned.start, min(trace.owned.stop, trace.samples - 2 * span))
        if own.stop <= own.start:
            return
        bent = (trace.q[2 * span :] - 2.0 * trace.q[span:-span] + trace.q[: -2 * span])[own]
        for histogram, sizes in zip(self.bends, np.abs(bent).T, strict=True):
            histogram.add(sizes)
        if not np.isfinite(trace.q).all():
            return
        squares = bent**2 / (span * trace.step_s) ** 4
        count = own.stop - own.start
        self.curves[:, 0] += squares.sum(axis=0)
        self.curves[:, 1] += 6.0 * count / (span * trace.step_s) ** 4
        self.curved += count

    def curving(self, noise: FloatArray) -> FloatArray:
        """Rms of the joints' accelerations, (n,), without what noise of such deviations makes.

        Parameters
        ----------
        noise : (n,) array
        """
        squares = self.curves[:, 0] - self.curves[:, 1] * noise**2
        return np.asarray(np.sqrt(np.maximum(squares, 0.0) / max(self.curved, 1.0)))

    def _add_others(self, trace: Trace) -> None:
        """Efforts, strokes and rails, as far as an equation uses them."""
        dry = not (np.isfinite(trace.p_a).any() or np.isfinite(trace.p_b).any())
        for joint in range(self.robot.dof) if dry else self.robot.dry_joints:
            self.effort[joint].add(trace.joint_torque[:, joint], trace.owned, trace.step_s)
        for i, cylinder in enumerate(self.robot.cylinders):
            if not np.isfinite(trace.q[:, self.robot.joint_index(cylinder.joint)]).any():
                self.stroke[i].add(trace.stroke[:, i], trace.owned, trace.step_s)
        self.supply.add(trace.supply, trace.owned, trace.step_s)
        self.tank.add(trace.tank, trace.owned, trace.step_s)

    def _sensors(self) -> list[Sensor]:
        by_part = [self.q, self.effort, self.p_a, self.p_b, self.stroke]
        return [*(sensor for some in by_part for sensor in some), self.supply, self.tank]

    def merge(self, other: SignalSurvey) -> None:
        """Take in what another look found."""
        for sensor, more in zip(self._sensors(), other._sensors(), strict=True):
            sensor.merge(more)
        for bends, others in zip(self.bends, other.bends, strict=True):
            bends.merge(others)
        self.low, self.high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        self.arm, self.volume = self.arm + other.arm, self.volume + other.volume
        self.samples = self.samples + other.samples
        self.curves, self.curved = self.curves + other.curves, self.curved + other.curved
        self.shortest = np.minimum(self.shortest, other.shortest)
        self.longest = np.maximum(self.longest, other.longest)
        for step_s, seconds in other.seconds.items():
            self._add_time(step_s, seconds)

    def _add_time(self, step_s: float, seconds: float) -> None:
        self.seconds[step_s] = self.seconds.get(step_s, 0.0) + seconds

    def mean_over_rates(self, value: Callable[[float], float]) -> float:
        """Mean over recorded time, in which rows are even, of what a sampling interval (s) gives.

        Parameters
        ----------
        value : callable
        """
        total = sum(self.seconds.values())
        # In order: sums are the same whichever recording comes first.
        return sum(value(step_s) * self.seconds[step_s] for step_s in sorted(self.seconds)) / total

    def largest_bend(self, joint: int) -> float:
        """Size that 99 % of a joint's `bends` do not pass; 0 where there are none."""
        return self.bends[joint].quantile(_LARGEST)

    @property
    def pose(self) -> FloatArray:
        """Mean joint positions, (n,)."""
        return np.array([sensor.mean for sensor in self.q])

    def mean_arm(self, cylinder: int) -> float:
        """Mean size of a cylinder's lever; 0 where its joint's angle is unknown."""
        return float(self.arm[cylinder] / max(self.samples[cylinder], 1.0))

    def mean_volume(self, cylinder: int, side: str) -> float:
        """Mean volume of a chamber.

        `side` is a or b.
        """
        total = self.volume[cylinder, 0 if side == "a" else 1]
        return float(total / max(self.samples[cylinder], 1.0))
