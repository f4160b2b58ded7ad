"""Pressures of a recording that look like another unit than Pa: bar, kPa, MPa or psi.

A pump that is off leaves pressures near the atmosphere, and nothing is said of it. What no machine
does is to stand in a vacuum, or to move its arm by oil that never leaves the atmosphere. A
transducer that is not connected reads anything: it accuses nothing but where numbers fit a pump.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.running import Spans
from hydro_ident.logs.plausible import USUAL_UNITS, pressure_reach_pa, pressure_units
from hydro_ident.logs.units import UNITS
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import Robot

#: What every sentence says.
CONTRACT = "the contract has Pa absolute"
#: A joint that goes through this share of its range is moved by its cylinder.
_MOVES = 0.01
#: Of `USUAL_UNITS` those in which readings are so small that even a machine at rest shows none of
#: it, and those of them that a transducer which is not connected does not pass for.
_SMALL, _SMALLEST = ("bar", "MPa", "psi"), ("bar", "MPa")
#: The most that a reading in kPa is taken to be, as a share of the supply. Chambers may hold more,
#: but by how much the rod says: a thick one would let any light load pass for another unit.
_MOST = 1.5
#: A pump that runs makes the robot's supply pressure, but for this factor.
_PUMP = 1.25
#: By what share its pressure varies at least over a recording, and at most.
_RIPPLES = (1e-3, 0.5)
#: What zeros that are off and noise make of an empty chamber, Pa gauge.
_LOWEST_PA = -2e5
_FIELDS = ("q", "p_a", "p_b", "supply")


@dataclass(frozen=True, slots=True)
class _Seen:
    """Lowest and highest of some pressures: Pa gauge, or numbers in no unit that is known."""

    low: float
    high: float

    def absolute(self, robot: Robot) -> _Seen:
        """As recorded, from vacuum on."""
        atmosphere_pa = robot.atmospheric_pressure_pa
        return _Seen(self.low + atmosphere_pa, self.high + atmosphere_pa)

    def with_other(self, other: _Seen) -> _Seen:
        """Both together."""
        return _Seen(min(self.low, other.low), max(self.high, other.high))

    def vacuum(self, robot: Robot) -> bool:
        """Whether all are nearly vacuum, and not just what an idle input reads."""
        most = min(_most(robot), 0.5 * robot.atmospheric_pressure_pa)
        return 0.0 < self.absolute(robot).high <= most

    def atmosphere(self, robot: Robot) -> bool:
        """Whether none leaves the atmosphere by more than a number in kPa would."""
        return max(abs(self.low), abs(self.high)) <= _most(robot)

    def taken(self, units: Iterable[str], least_pa: float, most_pa: float) -> list[str]:
        """Units in which the highest is within bounds, and none far below vacuum."""
        pa = {unit: UNITS["pressure"][unit] for unit in units}
        return [
            unit
            for unit, factor in pa.items()
            if least_pa <= self.high * factor <= most_pa and self.low * factor >= _LOWEST_PA
        ]


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
    chambers, supply = _together(_chambers(robot, spans, dead)), _together(_supply(spans))
    found = None
    if chambers is not None:
        found = _all_small(robot, chambers, supply)
        moved = _moved(robot, spans, dead)
        if found is None and moved:
            found = _moved_by_nothing(robot, chambers, supply, moved)
    if found is None and supply is not None:
        found = _of_supply(robot, supply, chambers)
    return found


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


def _most(robot: Robot) -> float:
    """The most that a number in kPa is: of bar, MPa and psi all are less."""
    return _MOST * robot.supply_pressure_pa / UNITS["pressure"]["kPa"]


def _all_small(robot: Robot, chambers: _Seen, supply: _Seen | None) -> tuple[str, str] | None:
    """Of supply and chambers that fit the robot's supply in another unit, moved or not."""
    if supply is None:
        return None
    supply_pa, number = robot.supply_pressure_pa, supply.absolute(robot)
    units = number.taken(_SMALLEST, supply_pa / _PUMP, _PUMP * supply_pa)
    units = chambers.absolute(robot).taken(units, 0.0, _MOST * supply_pa)
    every = chambers.with_other(supply)
    return ("pressures", _of_vacuum(robot, every)) if units else None


def _moved_by_nothing(
    robot: Robot, chambers: _Seen, supply: _Seen | None, moved: str
) -> tuple[str, str] | None:
    """Of chambers that move an arm and never leave the atmosphere, or stand in a vacuum."""
    reach = pressure_reach_pa(robot)
    if reach is None:
        return None
    if supply is not None and supply.high >= reach[0]:
        # The supply's reading shows what the unit is, so that zeros far off are the likelier.
        pump_pa = _PUMP * robot.supply_pressure_pa
        small = chambers.absolute(robot).taken(_SMALL, reach[0], pump_pa)
        found = chambers.vacuum(robot) and small
        return ("chambers", _of_vacuum(robot, chambers)) if found else None
    for name, seen in _groups(chambers, supply):
        if seen.vacuum(robot) and seen.absolute(robot).taken(USUAL_UNITS, *reach):
            return name, _of_vacuum(robot, seen)
        if seen.atmosphere(robot) and seen.taken(USUAL_UNITS, *reach):
            where = (
                f"within {max(abs(seen.low), abs(seen.high)):.4g} Pa of the atmosphere although"
                f" {moved} moved"
            )
            text = _text(robot, seen.high, where)
            return name, f"{text}; or something else than its oil moved the arm"
    return None


def _groups(chambers: _Seen, supply: _Seen | None) -> Iterator[tuple[str, _Seen]]:
    """What may look odd together, and its name."""
    if supply is None:
        yield "pressures", chambers
    else:
        yield "pressures", chambers.with_other(supply)
        yield "chambers", chambers


def _of_supply(robot: Robot, supply: _Seen, chambers: _Seen | None) -> tuple[str, str] | None:
    """Of a supply that varies as a pump's would, and of no chamber that says otherwise.

    One that is not connected, or off by much, reads anything: kPa and psi are not told from that.
    """
    supply_pa, number = robot.supply_pressure_pa, supply.absolute(robot)
    units = number.taken(_SMALLEST, supply_pa / _PUMP, _PUMP * supply_pa)
    ripple = 1.0 - number.low / number.high if number.high > 0.0 else 0.0
    if not units or not _RIPPLES[0] <= ripple <= _RIPPLES[1]:
        return None
    if chambers is not None:
        reach = pressure_reach_pa(robot)
        most_pa = _MOST * number.high * max(UNITS["pressure"][unit] for unit in units)
        if reach is None or not reach[0] <= chambers.high <= most_pa:
            return None
    return "supply", _of_vacuum(robot, supply)


def _of_vacuum(robot: Robot, seen: _Seen) -> str:
    number = seen.absolute(robot).high
    return _text(robot, number, f"at most {number:.4g} Pa absolute, nearly vacuum")


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


def _moved(robot: Robot, spans: Mapping[str, Spans], dead: Collection[str]) -> str:
    """A joint that a cylinder moved of which both sides are read; empty where none was."""
    if not {"q", "p_a", "p_b"} <= spans.keys():
        return ""
    for i, cylinder in enumerate(robot.cylinders):
        names = {f"{cylinder.name}/{side}" for side in "ab"}
        if names & set(dead) or not (spans["p_a"].finite[i] and spans["p_b"].finite[i]):
            continue
        joint = robot.joint_index(cylinder.joint)
        lower, upper = limits(robot)[joint]
        if spans["q"].high[joint] - spans["q"].low[joint] > _MOVES * float(upper - lower):
            return cylinder.joint
    return ""
