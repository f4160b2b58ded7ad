"""What a diagnosis works on: recordings in memory, and the rows of their residual channels.

The rows are those of `identify` (force rows behind the parallel filter, chamber balances over
windows), laid out one channel after the other. Everything that is compared with a residual, the
base model's columns and every candidate's, is evaluated on the samples and then passes the same
filters onto the same rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.flows.chambers import Chamber, WindowSettings, chambers_of
from hydro_ident.estimate.forces.force_rows import ForceModel, Motion
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import (
    FilterSettings,
    parallel_filter,
)
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.rows import Rows
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.robot import FloatArray, Robot

Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A trace with its motion and the places of its rows.

    Attributes
    ----------
    trace : Trace
        Valve signals are held over holes that are short beside a window.
    moved : Motion or None
        None where a joint angle is missing.
    kept : (T,) int array
        Samples of the force rows.
    starts : tuple of (W,) int array
        First samples of each chamber's windows.
    span : int
        Samples of a window.
    number : int
        Among the material's; those with corrected sensors keep it.
    stopped : (N, n) bool array or None
        Samples whose joint rests at an end of its travel.
    still : frozenset of int
        Joints that stand still throughout the recording, if only about.
    """

    trace: Trace
    moved: Motion | None
    kept: IndexArray
    starts: tuple[IndexArray, ...]
    span: int
    number: int = 0
    stopped: BoolArray | None = None
    still: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Place:
    """Where the rows of a channel of a stretch stand.

    Attributes
    ----------
    stretch : int
    channel : int
    rows : slice
        Of the stacked rows.
    """

    stretch: int
    channel: int
    rows: slice


@dataclass(frozen=True, slots=True)
class Material:
    """Recordings as stacked rows of all residual channels.

    Attributes
    ----------
    robot : Robot
        As given.
    forces : ForceModel
    filters : FilterSettings
    windows : WindowSettings
    stretches : tuple of Stretch
    channels : tuple of str
        Force channels that were measured, then flows.
    units : tuple of str
    places : tuple of Place
        By channel, then by time.
    channel, recording : (N,) int array
    time_s : (N,) array
    linked : (N,) bool array
        Whether a row follows the one before it without a gap.
    rest_speed : (n,) array or None
        Speed of a resting joint by its position's noise alone, behind the parallel filter, where
        that is to be reckoned with.
    chambers : tuple of Chamber
        Of the robot, in the order of `Stretch.starts`.
    """

    robot: Robot
    forces: ForceModel
    filters: FilterSettings
    windows: WindowSettings
    stretches: tuple[Stretch, ...]
    channels: tuple[str, ...]
    units: tuple[str, ...]
    places: tuple[Place, ...]
    channel: IndexArray
    recording: IndexArray
    recordings: tuple[str, ...]
    time_s: FloatArray
    linked: BoolArray
    rest_speed: FloatArray | None = None
    chambers: tuple[Chamber, ...] = field(init=False)
    _chamber_of: dict[int, int] = field(init=False)

    def __post_init__(self) -> None:
        chambers = chambers_of(self.robot)
        names = [chamber.channel for chamber in chambers]
        known = {k: names.index(c) for k, c in enumerate(self.channels) if c in names}
        object.__setattr__(self, "chambers", chambers)
        object.__setattr__(self, "_chamber_of", known)

    @property
    def size(self) -> int:
        """Number of rows N."""
        return int(self.time_s.size)

    def joint_of(self, channel: int) -> int:
        """Index of a channel's joint."""
        return self.robot.joint_index(self.channels[channel].split("/")[0])

    def is_flow(self, channel: int) -> bool:
        """Whether a channel is a chamber's balance."""
        return "/flow_" in self.channels[channel]

    def chamber_index(self, channel: int) -> int:
        """Index in `chambers` of a flow channel."""
        return self._chamber_of[channel]

    @property
    def unpaired(self) -> tuple[str, ...]:
        """Balances of cylinders of whose other chamber no pressure was ever read."""
        return tuple(
            chamber.channel
            for chamber in self.chambers
            if chamber.channel in self.channels
            and not any(
                np.isfinite(other_pressure(chamber, s.trace)).any() for s in self.stretches
            )
        )

    def of_channels(self, chosen: Sequence[int]) -> list[Place]:
        """Places of some channels."""
        wanted = set(chosen)
        return [place for place in self.places if place.channel in wanted]

    def positions(self) -> FloatArray:
        """Position of each row's own joint, (N,)."""
        result = np.zeros(self.size)
        for place in self.places:
            stretch = self.stretches[place.stretch]
            own = stretch.trace.q[:, self.joint_of(place.channel)]
            result[place.rows] = self.on_rows(stretch, place.channel, own)
        return result

    def filtered(self, stretch: Stretch, values: FloatArray) -> FloatArray:
        """Sampled forces (N, ...) on the force rows."""
        finite = np.where(np.isfinite(values), values, 0.0)
        return parallel_filter(finite, stretch.trace.step_s, self.filters, stretch.kept)

    @staticmethod
    def windowed(stretch: Stretch, chamber: int, steps: FloatArray) -> FloatArray:
        """Volumes per sampling interval, (N - 1, ...), as mean flows of a chamber's windows.

        A window that touches an unknown volume counts nothing, in no column: one that lacks a part
        of its balance would be a flow that nothing explains.

        `steps` are the volumes.
        """
        from hydro_ident.mismatch.rows.row_kernels import window_means

        start, length_s = stretch.starts[chamber], stretch.span * stretch.trace.step_s
        columns = np.ascontiguousarray(steps.reshape(len(steps), -1))
        means = window_means(columns, start, stretch.span, length_s)
        return np.asarray(means.reshape(start.size, *steps.shape[1:]))

    def on_rows(self, stretch: Stretch, channel: int, values: NDArray[Value]) -> NDArray[Value]:
        """Samples (T, ...) of a stretch at the middles of a channel's rows."""
        if not self.is_flow(channel):
            return values[stretch.kept]
        return values[stretch.starts[self.chamber_index(channel)] + stretch.span // 2]

    @property
    def stopped(self) -> BoolArray:
        """Rows of forces of which an unknown part is borne by their joint's stop, (N,)."""
        result = np.zeros(self.size, dtype=np.bool_)
        for place in self.places:
            stretch = self.stretches[place.stretch]
            if stretch.stopped is not None and not self.is_flow(place.channel):
                own = stretch.stopped[:, self.joint_of(place.channel)]
                result[place.rows] = self.on_rows(stretch, place.channel, own)
        return result

    def commanded(self) -> list[int]:
        """Cylinders whose valve was commanded: its signal is not the same all the while."""
        signals = [s.trace.valve_signal for s in self.stretches]
        known = [[u[np.isfinite(u[:, i]), i] for u in signals]
                 for i in range(len(self.robot.cylinders))]  # fmt: skip
        return [i for i, own in enumerate(known) if any((u != u[:1]).any() for u in own)]

    def masks(self, split: HoldOut) -> tuple[BoolArray, BoolArray]:
        """Rows to fit and rows to score of a split."""
        fit, score = np.zeros(self.size, dtype=np.bool_), np.zeros(self.size, dtype=np.bool_)
        for place in self.places:
            index = np.arange(place.rows.start, place.rows.stop)
            rows = Rows(
                index[:, None].astype(float),
                np.zeros((index.size, 1, 0)),
                self.time_s[place.rows],
                self.stretches[place.stretch].trace.label,
            )
            fit[split.training(rows).y[:, 0].astype(int)] = True
            if split.every:
                score[split.held_out(rows).y[:, 0].astype(int)] = True
        return fit & ~self.stopped, score & ~self.stopped


def pressure_of(chamber: Chamber, trace: Trace) -> FloatArray:
    """Pressure of a chamber, (N,)."""
    return np.asarray((trace.p_a if chamber.side == "a" else trace.p_b)[:, chamber.index])


def other_pressure(chamber: Chamber, trace: Trace) -> FloatArray:
    """Pressure of the other chamber of a chamber's cylinder, (N,)."""
    return np.asarray((trace.p_b if chamber.side == "a" else trace.p_a)[:, chamber.index])
