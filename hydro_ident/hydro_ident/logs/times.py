"""Columns of a log that are times: how they run beside each other, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.logs.file import Log
from hydro_ident.logs.guess import Reading
from hydro_ident.logs.units import UNITS
from hydro_model.arrays import FloatArray

#: Seconds of 1970 that a log may have been written at: from 2000 to the end of the stamps, which
#: are int32; and the `start` of such a log.
EPOCH_S = (946_684_800.0, 2.0**31)
EPOCH = "1970-01-01T00:00:00Z"
#: LabVIEW's zero, how much earlier it is, s, and the longest step of a log that counts from it.
LABVIEW, _EARLIER_S, _STEP_S = "1904-01-01T00:00:00Z", 2_082_844_800.0, 10.0
#: Share of steps that may fail to increase in what is still a time: a few bad lines.
_FEW = 0.01
#: Two times run alike where their paces differ by no more than this.
_ALIKE = 0.05
#: Spans of two clocks of one log are no further apart than this factor.
_SPANS = 30.0
_SPAN_UNITS = ("s", "ms", "us", "ns")
#: A vector that nothing calls a time may be one where its steps differ by no more than this share,
#: and it spans about what the log does: less where it was triggered late or stopped early, hardly
#: more. A counter does so in some unit, too, one time in four: it is a guess.
_EVEN, _SAME_RUN = 0.01, (0.25, 1.2)


def times_among(readings: Iterable[Reading], log: Log) -> list[Reading]:
    """Columns that are times by name or unit and, but for a few lines, increase.

    Parameters
    ----------
    readings : iterable of Reading
    log : Log

    Returns
    -------
    list of Reading
    """
    return [
        r for r in readings if r.quantity == "time" and _wrong_share(log.columns[r.column]) <= _FEW
    ]


def unnamed_times(
    readings: Sequence[Reading], log: Log, main_s: FloatArray, main_unit: str
) -> list[Reading]:
    """Vectors that nothing calls times and that may be: of signals that no time is as long as.

    Parameters
    ----------
    readings : sequence of Reading
        Of all columns.
    log : Log
    main_s : (N,) array
        The log's time, s.
    main_unit : str
        Its unit.

    Returns
    -------
    list of Reading
        As times, each a guess.
    """
    lengths = {r.column: len(log.columns[r.column]) for r in readings}
    timed = {lengths[r.column] for r in times_among(readings, log)}
    signals: dict[int, str] = {}
    for r in readings:
        if r.quantity not in ("", "time") and lengths[r.column] not in timed:
            signals.setdefault(lengths[r.column], r.column)
    found = []
    for r in readings:
        beside = signals.get(lengths[r.column])
        if r.quantity or r.unknown or beside is None:
            continue
        if _even_run(log.columns[r.column], main_s, main_unit):
            why = f"rises in even steps, with as many samples as '{beside}'"
            found.append(replace(r, quantity="time", level="guess", why=(why,)))
    return found


def _even_run(values: FloatArray, main_s: FloatArray, main_unit: str) -> bool:
    """Whether numbers rise in even steps over about what the log's time does, in some unit."""
    steps = np.diff(values)
    if len(steps) < 2 or not float(np.ptp(steps)) <= _EVEN * float(np.median(steps)):
        return False
    unit = unit_beside(values, "", main_s, main_unit)
    span = float(values[-1] - values[0]) * UNITS["time"].get(unit, 0.0)
    known = main_s[np.isfinite(main_s)]
    whole = float(known[-1] - known[0]) if len(known) > 1 else 0.0
    # A padded end of the log's time leaves it no length.
    return whole > 0.0 and _SAME_RUN[0] <= span / whole <= _SAME_RUN[1]


def _wrong_share(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(np.diff(known) <= 0.0)) if len(known) > 1 else 1.0


def stop_of(log: Log, column: str, factor: float = 1.0) -> str:
    """Where a time stops increasing, and what to try.

    Parameters
    ----------
    log : Log
    column : str
    factor : float
        To seconds, for the rate.

    Returns
    -------
    str
        Empty where it increases throughout.
    """
    values = log.columns[column]
    at = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[at])
    wrong = np.flatnonzero(steps <= 0.0)
    if not len(wrong):
        return ""
    k = int(wrong[0])
    before, after = float(values[at[k]]), float(values[at[k + 1]])
    text = f"{before:.12g} and then {after:.12g} at {log.place(column, int(at[k + 1]))}"
    text += f"; {len(wrong)} of {len(steps)} steps are so" if len(wrong) > 1 else ""
    return f"{text}; {_to_try(steps, after - before, factor)}"


def _to_try(steps: FloatArray, step: float, factor: float) -> str:
    span = float(steps.sum()) * factor
    rate = f" (its mean is {len(steps) / span:.6g} Hz)" if span > 0.0 else ""
    rounded = f"times that were rounded too coarsely: give time: {{rate_hz: ...}}{rate}"
    if step < 0.0:
        return (
            "a clock that was set, or a second recording in the file: leave such lines out of a"
            " copy of the file, or split it there"
        )
    few = float(np.mean(steps <= 0.0)) <= _FEW
    return (
        f"a line that was written twice: leave it out of a copy; or {rounded}" if few else rounded
    )


@dataclass(frozen=True, slots=True)
class Beside:
    """How a time runs beside the log's own, on the rows that both have.

    Attributes
    ----------
    lines : int
        In how many it has a value.
    fewer : bool
        It has fewer than the log's time.
    from_top : bool
        Its rows are the table's first: no others lie between them.
    pace : float
        Seconds of it in a second of the log's time; NaN where there is no telling.
    shift_s : float
        How much later than the log's time it begins.
    near : bool
        It never is further from the log's time than its own period: the same instants.
    """

    lines: int
    fewer: bool
    from_top: bool
    pace: float
    shift_s: float
    near: bool

    @property
    def alike(self) -> bool:
        """Whether the two run at the same pace."""
        return abs(self.pace - 1.0) <= _ALIKE

    @property
    def apart(self) -> bool:
        """Whether rows cannot be what pairs the two: a table of blocks with times of their own."""
        return self.fewer and not self.near and (self.from_top or not self.alike)

    def words(self) -> str:
        """The same for a person."""
        begins = f"begins {self.shift_s:.6g} s after it"
        if self.alike or not np.isfinite(self.pace):
            return begins
        return f"{begins} and runs {self.pace:.3g} times as fast in the same lines"


def beside(own_s: FloatArray, main_s: FloatArray) -> Beside:
    """Compare a time with the log's own.

    Parameters
    ----------
    own_s, main_s : (N,) array
        Seconds; NaN where there is none.

    Returns
    -------
    Beside
    """
    has, both = np.isfinite(own_s), np.isfinite(own_s) & np.isfinite(main_s)
    count = int(has.sum())
    own, main = own_s[both], main_s[both]
    span = float(main[-1] - main[0]) if len(main) > 1 else 0.0
    period = float(np.median(np.diff(own))) if len(own) > 1 else 0.0
    return Beside(
        lines=count,
        fewer=count < int(np.isfinite(main_s).sum()),
        from_top=bool(has[:count].all()),
        pace=float(own[-1] - own[0]) / span if span > 0.0 else float("nan"),
        shift_s=float(own[0] - main[0]) if len(own) else float("nan"),
        near=len(own) > 0 and float(np.abs(own - main).max()) <= abs(period),
    )


def epoch_unit(values: FloatArray) -> str:
    """Unit in which a time counts from 1970.

    Parameters
    ----------
    values : (N,) array

    Returns
    -------
    str
        Empty: it does not.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return ""
    low, high = float(known.min()), float(known.max())
    for unit in _SPAN_UNITS:
        factor = UNITS["time"][unit]
        if EPOCH_S[0] <= low * factor and high * factor < EPOCH_S[1]:
            return unit
    return ""


def counts_from(values: FloatArray) -> tuple[str, str]:
    """Unit and zero of a time that counts from 1970, or in seconds from 1904 as LabVIEW's.

    Parameters
    ----------
    values : (N,) array

    Returns
    -------
    str, str
        The zero as a mapping's `start`; both empty: it does neither.
    """
    if unit := epoch_unit(values):
        return unit, EPOCH
    known = values[np.isfinite(values)]
    # A counter of us would have larger steps.
    if len(known) > 1 and 0.0 < float(np.median(np.diff(known))) < _STEP_S:
        low, high = float(known.min()) - _EARLIER_S, float(known.max()) - _EARLIER_S
        if EPOCH_S[0] <= low and high < EPOCH_S[1]:
            return "s", LABVIEW
    return "", ""


def unit_beside(values: FloatArray, declared: str, main_s: FloatArray, main_unit: str) -> str:
    """Unit of a further time: the file's, or one in which it spans about what the log does.

    Parameters
    ----------
    values : (N,) array
    declared : str
        As the file has it; empty: it has none.
    main_s : (N,) array
        The log's time, s.
    main_unit : str
        Its unit, which is tried first.

    Returns
    -------
    str
        Empty where none fits.
    """
    if declared or (declared := counts_from(values)[0]):
        return declared
    known, main = values[np.isfinite(values)], main_s[np.isfinite(main_s)]
    if len(known) < 2 or len(main) < 2 or main[-1] == main[0]:
        return ""
    share = {
        unit: float(known[-1] - known[0]) * UNITS["time"][unit] / float(main[-1] - main[0])
        for unit in dict.fromkeys((main_unit, *_SPAN_UNITS))
    }
    return next((u for u, s in share.items() if 1.0 / _SPANS < s < _SPANS), "")
