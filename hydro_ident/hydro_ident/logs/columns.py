"""Signals of a log as quantities on the cycles of a bag, and what was done to them."""

from __future__ import annotations

import math

import numpy as np

from hydro_ident.bag.grid import readings
from hydro_ident.errors import BagError
from hydro_ident.logs.clocks import Timeline, clock_of
from hydro_ident.logs.file import Log
from hydro_ident.logs.guess import read_columns
from hydro_ident.logs.map import LogMap
from hydro_ident.logs.signal import LogSignal, turns
from hydro_ident.logs.targets import MARGIN
from hydro_ident.logs.times import times_among
from hydro_model.arrays import FloatArray

#: Periods by which angles are wrapped.
_PERIODS = (360.0, 2.0 * math.pi)
#: A jump is one of a wrapped angle where it misses its period by no more than this share; other
#: steps of the signal are smaller than this share of it.
_MISSES = 0.15
#: Rails, and what the robot file calls their constants.
_RAILS = {
    "pressures, supply": "supply: pressure_pa",
    "pressures, tank": "supply: tank_pressure_pa",
}


def wrap_of(recorded: FloatArray) -> float:
    """Period by which an angle seems to be wrapped.

    Parameters
    ----------
    recorded : (N,) array

    Returns
    -------
    float
        360 or 2 pi; 0 where nothing jumps by it.
    """
    steps = np.abs(np.diff(recorded[np.isfinite(recorded)]))
    for period in _PERIODS:
        jumps = np.abs(steps - period) <= _MISSES * period
        if jumps.any() and bool((steps[~jumps] <= _MISSES * period).all()):
            return period
    return 0.0


def _middle(values: FloatArray) -> float:
    """Median of what is known; 0 where nothing is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


class Columns:
    """Signals of a log on the cycles of a bag.

    Parameters
    ----------
    log : Log
    mapping : LogMap
    timeline : Timeline

    Attributes
    ----------
    log, mapping, timeline
        As given.
    used : set of str
        Signals of the log that were taken, their clocks among them.
    remarks : list of str
        What was done to values, and what looks odd.
    warnings : list of str
        What cannot be as the mapping says.
    """

    def __init__(self, log: Log, mapping: LogMap, timeline: Timeline) -> None:
        self.log, self.mapping, self.timeline = log, mapping, timeline
        self.used = set(timeline.rows) | ({mapping.time.signal} if mapping.time else set())
        self.remarks: list[str] = []
        self.warnings: list[str] = []
        #: By joint: the angle that was asked for first, the joint's own before its reference.
        self._angles: dict[str, FloatArray] = {}

    @property
    def count(self) -> int:
        """Number of cycles."""
        return len(self.timeline.stamps_ns)

    def of(
        self, signal: LogSignal | None, where: str, field: str, joint: str = ""
    ) -> FloatArray | None:
        """A quantity on the cycles.

        Parameters
        ----------
        signal : LogSignal or None
        where : str
            Who asks, for messages.
        field : str
            Of the messages that will carry it, as of `hydro_ident.bag.grid.readings`.
        joint : str
            Whose angle it is; whole turns bring it nearest to the joint's range, and a further one
            of the same joint, its reference, nearest to that.

        Returns
        -------
        (N,) array or None
            NaN at cycles that hold no sample of it.

        Raises
        ------
        BagError
            A signal is missing, of another length than its time, or holds no number.
        """
        if signal is None:
            return None
        if not signal.names:
            held = np.full(self.count, signal.offset)
            if joint:
                self._angles.setdefault(joint, held)
            if where in _RAILS:
                self.remarks.append(
                    f"{where}: one number throughout counts as a reading, of whose error no"
                    " interval knows; left out here and written in the robot file"
                    f" ({_RAILS[where]}, gauge) intervals reach as far as it may be off"
                )
            return held
        self._check_instants(signal)
        rows = self.timeline.rows[clock_of(self.log, self.mapping, signal)]
        columns = [self._recorded(name, where, len(rows)) for name in signal.names]
        recorded = columns[0] - columns[1] if signal.minus else columns[0]
        recorded = self._readings(recorded, signal, where, field)
        if not np.isfinite(recorded).any():
            raise BagError(
                f"{self.log.path}: '{' - '.join(signal.names)}' holds no number"
                + self.log.why_unread(*signal.names)
            )
        self._say_wraps(recorded, signal, where)
        self._say_beginning(recorded, rows, where)
        placed = np.full(self.count, np.nan)
        placed[rows[rows >= 0]] = signal.values(recorded)[rows >= 0]
        if signal.wrap and joint:
            placed = self._turned(placed, abs(signal.factor) * signal.wrap, joint, where)
        if joint:
            self._angles.setdefault(joint, placed)
            self._warn_outside(placed, joint, where)
        return placed

    def _check_instants(self, signal: LogSignal) -> None:
        """What is subtracted has to be of the same instants."""
        if not signal.minus:
            return
        if signal.time and signal.time not in self.log.clocks.values():
            return  # The mapping knows a time of both that the file does not pair with them.
        main = self.mapping.time.signal if self.mapping.time is not None else ""
        clocks = [self.log.clocks.get(name, main) for name in signal.names]
        one, other = (self.log.columns.get(clock, np.empty(0)) for clock in clocks)
        if clocks[0] != clocks[1] and not np.array_equal(one, other, equal_nan=True):
            raise BagError(
                f"{self.log.path}: expected '{signal.signal}' and '{signal.minus}' of the same"
                f" instants, found one by '{clocks[0]}' and one by '{clocks[1]}': save both by one"
                " clock"
            )

    def _recorded(self, name: str, where: str, count: int) -> FloatArray:
        column = self.log.column(name, where)
        self.used.add(name)
        if len(column) != count:
            times = times_among(read_columns(self.log), self.log)
            alike = [r.column for r in times if len(self.log.columns[r.column]) == len(column)]
            hint = f" ('{alike[0]}' has as many)" if alike else ""
            raise BagError(
                f"{self.log.path}: expected {count} samples of '{name}' as of its time, found"
                f" {len(column)}: name its own with 'time: SIGNAL'{hint}"
            )
        return column

    def _readings(
        self, recorded: FloatArray, signal: LogSignal, where: str, field: str
    ) -> FloatArray:
        """Without numbers that stand for no reading: no jump is one of theirs, nor a range."""
        lost = np.isfinite(recorded) & np.isnan(readings(signal.factor * recorded, field))
        if not lost.any():
            return recorded
        self.remarks.append(f"{where}: {lost.sum()} samples beyond any physical size left out")
        return np.where(lost, np.nan, recorded)

    def _say_wraps(self, recorded: FloatArray, signal: LogSignal, where: str) -> None:
        if signal.wrap:
            count = turns(recorded, signal.wrap)
            self.remarks.append(f"{where}: {count} jumps by {signal.wrap:.6g} taken out")
        elif (period := wrap_of(recorded)) > 0.0:
            self.remarks.append(
                f"{where}: {turns(recorded, period)} jumps by about {period:.6g}; if the angle is"
                f" wrapped, give wrap: {period:.9g}"
            )

    def _turned(self, values: FloatArray, turn: float, joint: str, where: str) -> FloatArray:
        """An angle by the whole turns that bring it to where its joint can be, or is."""
        away, place = self._away(values, joint)
        if not (turn > 0.0 and math.isfinite(away / turn)):
            return values
        whole = round(away / turn)
        if whole:
            self.remarks.append(f"{where}: {whole:+d} turns, nearest to the joint's {place}")
        return values + whole * turn

    def _away(self, values: FloatArray, joint: str) -> tuple[float, str]:
        """How far the joint's own angle, else the middle of its range, is above an angle."""
        if (angle := self._angles.get(joint)) is not None:
            apart = angle - values
            shared = bool(np.isfinite(apart).any())
            return _middle(apart) if shared else _middle(angle) - _middle(values), "angle"
        robot = self.mapping.robot
        limits = next((j for j in robot.joints if j.name == joint), None) if robot else None
        if limits is None or not (math.isfinite(limits.lower) and math.isfinite(limits.upper)):
            return 0.0, "range"
        return 0.5 * (limits.lower + limits.upper) - _middle(values), "range"

    def _warn_outside(self, values: FloatArray, joint: str, where: str) -> None:
        """An angle that its joint cannot have: zero, sign or unit are not the robot's."""
        robot = self.mapping.robot
        limits = next((j for j in robot.joints if j.name == joint), None) if robot else None
        known = values[np.isfinite(values)]
        if limits is None or not len(known) or not math.isfinite(limits.upper - limits.lower):
            return
        margin = MARGIN * (limits.upper - limits.lower)
        outside = (known < limits.lower - margin) | (known > limits.upper + margin)
        if outside.any():
            self.warnings.append(
                f"{where}: expected {limits.lower:.4g} to {limits.upper:.4g} rad, found"
                f" {known.min():.4g} to {known.max():.4g} rad, {outside.mean():.0%} of it outside"
                " the joint's range: give its sign and offset (or minus), or the unit it is in"
            )

    def _say_beginning(self, recorded: FloatArray, rows: np.ndarray, where: str) -> None:
        """A channel that was triggered later than the others."""
        first = int(np.flatnonzero(np.isfinite(recorded))[0])
        if first and (rows >= 0).any() and rows[first] >= 0:
            stamps = self.timeline.stamps_ns
            late_s = (stamps[rows[first]] - stamps[0]) * 1e-9
            # A slow channel in a fast table begins a little late; that is its rate.
            gap = np.diff(np.flatnonzero(np.isfinite(recorded)))
            if not len(gap) or first > 2 * int(np.median(gap)):
                self.remarks.append(f"{where}: first value {late_s:.6g} s after the beginning")
