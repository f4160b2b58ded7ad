"""Pressures of a recording that look like another unit than Pa: bar, kPa, MPa or psi.

A pump that is off leaves pressures near the atmosphere, and nothing is said of it. What no machine
does is to stand in a vacuum, or to move its arm by oil that never leaves the atmosphere.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.running import Spans
from hydro_ident.logs.plausible import pressure_reach_pa, pressure_units
from hydro_ident.logs.units import UNITS
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import Robot

#: What every sentence says.
CONTRACT = "the contract has Pa absolute"
#: A joint that goes through this share of its range is moved by its cylinder.
_MOVES = 0.01
#: Of a machine at rest what is below all that a reading in bar can be is told, of one that moves
#: what is below all that one in kPa can be. A transducer's zero that is off reaches the latter.
_AT_REST, _MOVING = UNITS["pressure"]["bar"], UNITS["pressure"]["kPa"]
#: The most that such a reading is, as a share of the supply. Chambers may hold more, but by how
#: much the rod says: a thick one would let any light load pass for another unit.
_MOST = 1.5
_FIELDS = ("q", "p_a", "p_b", "supply")


@dataclass(frozen=True, slots=True)
class _Seen:
    """Lowest and highest of some pressures, Pa gauge."""

    low: float
    high: float

    def vacuum(self, robot: Robot, top_pa: float, moved: bool) -> bool:
        """Whether all are nearly vacuum and not just what an idle input reads; `top_pa`: most."""
        absolute = self.high + robot.atmospheric_pressure_pa
        most = top_pa / (_MOVING if moved else _AT_REST)
        return 0.0 < absolute <= min(most, 0.5 * robot.atmospheric_pressure_pa)

    def atmosphere(self, top_pa: float) -> bool:
        """Whether none leaves the atmosphere by more than a number in kPa would."""
        return max(abs(self.low), abs(self.high)) <= top_pa / _MOVING


def spans_of(recording: Recording) -> dict[str, Spans]:
    """From where to where the signals go that tell units of pressures apart.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    dict of str to Spans
        By field of the recording.
    """
    spans = {}
    for name in _FIELDS:
        values = getattr(recording, name)
        if values is not None:
            columns = values[:, None] if values.ndim == 1 else values
            spans[name] = Spans(columns.shape[1])
            spans[name].add(columns)
    return spans


def mistaken_pressures(
    robot: Robot, spans: Mapping[str, Spans], dead: Collection[str] = ()
) -> tuple[str, str] | None:
    """Which pressures look like another unit, and why.

    Parameters
    ----------
    robot : Robot
    spans : mapping of str to Spans
        By field, as of `spans_of`.
    dead : collection of str
        Chambers that are not looked at, as of `Recording`.

    Returns
    -------
    pair of str or None
        `pressures`, `chambers` or `supply`, and a sentence about them; None where nothing is odd.
    """
    if pressure_reach_pa(robot) is None:
        return None
    top_pa = _MOST * robot.supply_pressure_pa
    chambers, supply = _together(_chambers(robot, spans, dead)), _together(_supply(spans))
    moved = _moved(robot, spans)
    every = _together(seen for seen in (chambers, supply) if seen is not None)
    for name, seen in (("pressures", every), ("chambers", chambers), ("supply", supply)):
        if seen is None:
            continue
        if seen.vacuum(robot, top_pa, bool(moved)):
            number = seen.high + robot.atmospheric_pressure_pa
            where = f"at most {number:.4g} Pa absolute, nearly vacuum"
            return name, _text(robot, number, where)
        # An arm may sink while the pump is off: chambers hold its weight.
        if moved and name != "supply" and seen.atmosphere(top_pa):
            where = (
                f"within {max(abs(seen.low), abs(seen.high)):.4g} Pa of the atmosphere although"
                f" {moved} moved"
            )
            text = _text(robot, seen.high, where)
            return name, f"{text}; or something else than its oil moved the arm"
    return None


def mistaken_notes(recordings: Iterable[Recording]) -> list[str]:
    """Recordings whose pressures look like another unit.

    Parameters
    ----------
    recordings : iterable of Recording

    Returns
    -------
    list of str
        A sentence per recording.
    """
    notes = []
    for recording in recordings:
        found = mistaken_pressures(recording.robot, spans_of(recording), recording.dead)
        if found is not None:
            notes.append(f"{recording.path.name}: {found[0]}: {found[1]}")
    return notes


def _text(robot: Robot, number: float, where: str) -> str:
    units = " or ".join(pressure_units(robot, number)) or "another unit"
    supply = robot.supply_pressure_pa + robot.atmospheric_pressure_pa
    return (
        f"look like {units}: {where}, expected up to about {supply:.3g} Pa, the supply of"
        f" {robot.name}; {CONTRACT}"
    )


def _chambers(robot: Robot, spans: Mapping[str, Spans], dead: Collection[str]) -> Iterator[_Seen]:
    for side in "ab":
        of_side = spans.get(f"p_{side}")
        for i, cylinder in enumerate(robot.cylinders):
            if of_side is not None and f"{cylinder.name}/{side}" not in dead:
                yield _Seen(float(of_side.low[i]), float(of_side.high[i]))


def _supply(spans: Mapping[str, Spans]) -> Iterator[_Seen]:
    if "supply" in spans:
        yield _Seen(float(spans["supply"].low[0]), float(spans["supply"].high[0]))


def _together(every: Iterable[_Seen]) -> _Seen | None:
    """What some go through together; None where none has a number."""
    known = [seen for seen in every if np.isfinite(seen.high)]
    if not known:
        return None
    return _Seen(min(seen.low for seen in known), max(seen.high for seen in known))


def _moved(robot: Robot, spans: Mapping[str, Spans]) -> str:
    """A joint that its cylinder moved; empty where none was."""
    if "q" not in spans:
        return ""
    for cylinder in robot.cylinders:
        joint = robot.joint_index(cylinder.joint)
        lower, upper = limits(robot)[joint]
        if spans["q"].high[joint] - spans["q"].low[joint] > _MOVES * float(upper - lower):
            return cylinder.joint
    return ""
