"""How long a recording goes on without a hole, and which sensors are in part of it only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.streaming import Piece, cut_recording
from hydro_ident.estimate.signals.bridging import LONGEST_HOLE_S
from hydro_ident.estimate.signals.parting import LONG_LOSS
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.robot import FloatArray


@dataclass(slots=True)
class Continuity:
    """Counted piece by piece, over all cycles.

    Attributes
    ----------
    cycles : int
    missing : dict of str to int
        Cycles without a reading, by sensor (`lift position`, `lift_cylinder/a`, `lift effort`).
    stretches : int
        Stretches in which what is needed is there in every cycle.
    longest_s : float
        The longest of them.
    bridged : int
        Cycles without a reading that were filled in between their neighbours.
    lost_s : float
        In cycles that belong to no stretch.
    """

    cycles: int = 0
    missing: dict[str, int] = field(default_factory=dict)
    stretches: int = 0
    longest_s: float = 0.0
    bridged: int = 0
    lost_s: float = 0.0
    _begin_s: float = 0.0
    _end_s: float = -np.inf

    def add(self, piece: Piece, traces: Sequence[Trace]) -> None:
        """Take in the core of the next piece, and the traces of it."""
        core = cut_recording(piece.recording, piece.core)
        self.cycles += len(core)
        for name, values in _sensors(core):
            absent = int(np.isnan(values).sum())
            self.missing[name] = self.missing.get(name, 0) + absent
        owned = sum(trace.owned.stop - trace.owned.start for trace in traces)
        self.lost_s += (len(core) - owned) * core.period_s
        for trace in traces:
            self.bridged += trace.bridged
            begin_s = float(trace.time_s[trace.owned.start])
            # A stretch goes on from piece to piece.
            if begin_s - self._end_s > 1.5 * trace.step_s:
                self.stretches, self._begin_s = self.stretches + 1, begin_s
            self._end_s = float(trace.time_s[trace.owned.stop - 1])
            self.longest_s = max(self.longest_s, self._end_s - self._begin_s)

    @property
    def partial(self) -> dict[str, float]:
        """Sensors that are read, but not in a large share of the cycles, and that share."""
        shares = {name: count / max(self.cycles, 1) for name, count in self.missing.items()}
        return {name: share for name, share in shares.items() if LONG_LOSS < share < 1.0}

    @property
    def missed(self) -> dict[str, int]:
        """Sensors without a reading in fewer cycles than that, and in how many."""
        few = LONG_LOSS * self.cycles
        return {name: count for name, count in self.missing.items() if 0 < count <= few}


def _sensors(recording: Recording) -> Iterator[tuple[str, FloatArray]]:
    """Readings of force and position by sensor; none in what this part of it does not have."""
    robot = recording.robot
    joints, cylinders = robot.joint_names, [c.name for c in robot.cylinders]
    for names, values, kind in (
        (joints, recording.q, " position"),
        (joints, recording.effort, " effort"),
        (cylinders, recording.p_a, "/a"),
        (cylinders, recording.p_b, "/b"),
    ):
        nothing = np.full((len(recording), len(names)), np.nan)
        columns = nothing if values is None else values
        yield from zip((f"{name}{kind}" for name in names), columns.T, strict=True)


def partly_read(continuities: Sequence[Continuity]) -> tuple[str, str] | None:
    """Which sensors are missing in a large part of the cycles, and what would mend that.

    Parameters
    ----------
    continuities : sequence of Continuity
        Of the recordings.

    Returns
    -------
    tuple of str, or None
        None where no sensor is.
    """
    worst: dict[str, float] = {}
    for one in continuities:
        worst |= {n: max(share, worst.get(n, 0.0)) for n, share in one.partial.items()}
    if not worst:
        return None
    told = ", ".join(f"{name} in {share:.0%}" for name, share in worst.items())
    return (
        f"sensors are missing in part of the cycles ({told})",
        "record every sensor of a topic in each of its messages, with one stamp for a cycle",
    )


def partial_notes(names: Iterable[str], continuities: Iterable[Continuity]) -> list[str]:
    """Which sensors some recordings lack in a large part of their cycles.

    Parameters
    ----------
    names : iterable of str
        Of the recordings.
    continuities : iterable of Continuity
        Theirs.

    Returns
    -------
    list of str
        A sentence for each that lacks any.
    """
    return [
        f"{name}: {', '.join(f'{sensor} in {share:.0%}' for sensor, share in one.partial.items())}"
        " of the cycles without a reading: equations that need it are of the rest, as far as it is"
        " there for seconds on end"
        for name, one in zip(names, continuities, strict=True)
        if one.partial
    ]


def broken_up(continuities: Sequence[Continuity], total_s: float) -> str:
    """That gaps leave no stretch that is long enough for the filters.

    Parameters
    ----------
    continuities : sequence of Continuity
        Of the recordings.
    total_s : float
        Their duration.

    Returns
    -------
    str
        Empty where there are no gaps.
    """
    stretches = sum(one.stretches for one in continuities)
    if stretches <= len(continuities):
        return ""
    longest_s = max(one.longest_s for one in continuities)
    return (
        f"the longest of {stretches} stretches without a gap lasts {longest_s:.3g} s of"
        f" {total_s:.3g} s, too short for the filters"
    )


def bridged_notes(names: Iterable[str], continuities: Iterable[Continuity]) -> list[str]:
    """Which recordings have cycles that were filled in, and how many.

    Parameters
    ----------
    names : iterable of str
        Of the recordings.
    continuities : iterable of Continuity
        Theirs.

    Returns
    -------
    list of str
        A sentence for each that has any.
    """
    return [
        f"{name}: {one.bridged} cycles without a reading, in holes of one or up to"
        f" {1e3 * LONGEST_HOLE_S:g} ms, are bridged between their neighbours"
        for name, one in zip(names, continuities, strict=True)
        if one.bridged
    ]


def lost_notes(names: Iterable[str], continuities: Iterable[Continuity]) -> list[str]:
    """Which recordings have holes that are too long to be filled in, and of what.

    Parameters
    ----------
    names : iterable of str
        Of the recordings.
    continuities : iterable of Continuity
        Theirs.

    Returns
    -------
    list of str
        A sentence for each that has any.
    """
    return [
        f"{name}: {one.lost_s:.3g} s are left out, for want of readings"
        f" ({', '.join(f'{sensor} in {count} cycles' for sensor, count in one.missed.items())})"
        for name, one in zip(names, continuities, strict=True)
        if one.lost_s > LONGEST_HOLE_S and one.missed
    ]
