"""The mapping of a log: which signal is which joint, pressure or valve, and in which unit.

``value = sign * scale * (signal - minus, in its unit) + offset``, the offset in SI units, as in
the mapping of a bus (`hydro_ident.logs.signal`). The page `log_map` of hydro_msgs_docs has
every key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from hydro_ident.errors import BagError
from hydro_ident.logs.file import CsvLayout
from hydro_ident.logs.joint_units import quantity_of
from hydro_ident.logs.signal import (
    Clock,
    LogSignal,
    filled,
    no_other_keys,
    signal_of,
    unit_of,
)
from hydro_model.description.fields import Fields
from hydro_model.errors import RobotError
from hydro_model.robot import Robot
from hydro_model.robot_files import is_file, load_robot, read_yaml, shipped_robots

SCHEMA = "hydro_ident/log_map/1"
ATMOSPHERE_PA = 101325.0

#: Sections of the mapping and the quantity of their signals; the first unit is the default.
SECTIONS: dict[str, str] = {
    "joints": "position",
    "efforts": "effort",
    "strokes": "length",
    "pressures": "pressure",
    "valves": "voltage",
    "valve_commands": "voltage",
    "spools": "ratio",
    "references": "position",
}
#: Those whose signals are angles or ways of joints, by joint.
OF_JOINTS = frozenset(section for section, kind in SECTIONS.items() if kind == "position")
_KEYS = frozenset(
    {"schema", "robot", "time", "clocks", "start", "csv", "atmospheric_pressure_pa"}
    | {"oil_temperature"}
)


@dataclass(frozen=True, slots=True)
class LogMap:
    """A mapping that was read.

    Attributes
    ----------
    source : Path
    robot : Robot or None
        Where the mapping names one: its names are the only ones allowed.
    time : Clock or None
    rate_hz : float
        Of a log without time; 0 where `time` is given.
    clocks : mapping of str to Clock
        Of signals that have a time of their own, by its name in the log.
    from_s, to_s : float
        What lies outside is left out, in the log's own time.
    within_s : float
        Instants of different clocks that lie this close are one cycle; 0: a twentieth of the
        finest clock's period.
    common : bool
        Whether only instants are kept at which every signal has a value.
    start_ns : int
        Stamp of time 0.
    sections : mapping of str to mapping of str to LogSignal
        By the keys of `SECTIONS`, then by the name on the topic.
    oil_temperature : LogSignal or None
    layout : CsvLayout
    """

    source: Path
    robot: Robot | None
    time: Clock | None
    rate_hz: float
    clocks: Mapping[str, Clock]
    from_s: float
    to_s: float
    within_s: float
    common: bool
    start_ns: int
    sections: Mapping[str, Mapping[str, LogSignal]]
    oil_temperature: LogSignal | None
    layout: CsvLayout


def read_map(path: str | Path) -> LogMap:
    """Read a mapping file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    LogMap

    Raises
    ------
    BagError
        Missing, malformed, with unknown keys or units, or such as the robot's joint cannot have,
        or naming what its robot does not have.
    """
    path = Path(path)
    if not path.is_file():
        raise BagError(f"no mapping '{path}': expected a YAML file")
    try:
        return _map_from(read_yaml(path), path)
    except RobotError as error:
        raise BagError(str(error)) from error


def _map_from(top: Fields, path: Path) -> LogMap:
    schema = top.text("schema", SCHEMA)
    if schema != SCHEMA:
        raise BagError(f"{path}: expected schema {SCHEMA}, found '{schema}'")
    no_other_keys(top, _KEYS | set(SECTIONS))
    robot = (
        load_robot(_robot_path(top.text("robot"), path), narrow=True) if "robot" in top else None
    )
    given = ATMOSPHERE_PA if robot is None else robot.atmospheric_pressure_pa
    atmosphere = top.positive("atmospheric_pressure_pa", given)
    clock = top.fields("time")
    time, rate_hz = _time(clock)
    sections = {
        key: {
            name: signal_of(block.fields(name), quantity_of(quantity, name, robot), atmosphere)
            for name, block in _entries(top, key)
        }
        for key, quantity in SECTIONS.items()
    }
    if not any(sections.values()):
        raise BagError(f"{path}: expected signals under {', '.join(SECTIONS)}, found none")
    if robot is not None:
        _check_names(sections, robot, path)
    _check_apart(sections, path)
    oil = top.optional_fields("oil_temperature")
    return LogMap(
        source=path,
        robot=robot,
        time=time,
        rate_hz=rate_hz,
        clocks=_clocks(top, time),
        from_s=clock.number("from_s") if "from_s" in clock else -math.inf,
        to_s=clock.number("to_s") if "to_s" in clock else math.inf,
        within_s=clock.positive("within_s") if "within_s" in clock else 0.0,
        common=_kept(clock) == "common",
        start_ns=_start_ns(top),
        sections=sections,
        oil_temperature=None if oil is None else signal_of(oil, "temperature", 0.0),
        layout=_layout(top.fields("csv", {})),
    )


def _robot_path(name: str, path: Path) -> str:
    """A robot file beside the mapping, or else as `load_robot` takes it."""
    beside = path.parent / name
    if is_file(beside):
        return str(beside)
    # The name inside a robot file, which is often that of the file too.
    known = name in shipped_robots() or is_file(Path(name))
    if not known and is_file(Path(f"{beside}.hydraulics.yaml")):
        raise BagError(
            f"{path}: no robot file '{name}': did you mean '{name}.hydraulics.yaml', which lies"
            " beside it?"
        )
    return name


def _entries(top: Fields, key: str) -> list[tuple[str, Fields]]:
    block = top.optional_fields(key)
    return [] if block is None else [(name, block) for name in block.keys()]  # noqa: SIM118


def _time(fields: Fields) -> tuple[Clock | None, float]:
    cut = {"from_s", "to_s", "within_s", "keep"}
    if "rate_hz" in fields:
        no_other_keys(fields, {"rate_hz"} | cut)
        return None, fields.positive("rate_hz")
    no_other_keys(fields, {"signal", "unit", "late_s"} | cut)
    late_s = fields.number("late_s", 0.0)
    return Clock(filled(fields, "signal"), unit_of(fields, "time"), late_s), 0.0


def _kept(fields: Fields) -> str:
    keep = fields.text("keep", "all")
    if keep not in ("all", "common"):
        raise BagError(f"{fields.where}: 'keep' should be all or common, found '{keep}'")
    return keep


def _clocks(top: Fields, time: Clock | None) -> dict[str, Clock]:
    """Further clocks; without a unit they have that of `time`."""
    clocks = {}
    for name, block in _entries(top, "clocks"):
        fields = block.fields(name)
        no_other_keys(fields, {"unit", "late_s"})
        factor = unit_of(fields, "time") if "unit" in fields or time is None else time.factor
        clocks[name] = Clock(name, factor, fields.number("late_s", 0.0))
    return clocks


def _start_ns(top: Fields) -> int:
    """Stamp of time 0 from an ISO 8601 text; without it the beginning of the year 2000."""
    text = top.text("start", "2000-01-01T00:00:00+00:00")
    try:
        moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError as error:
        raise BagError(
            f"{top.where}: 'start' should be like 2026-03-01T09:30:00+00:00, found '{text}'"
        ) from error
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=timezone.utc)
    whole = moment.replace(microsecond=0).timestamp()
    return round(whole) * 1_000_000_000 + moment.microsecond * 1000


def _layout(fields: Fields) -> CsvLayout:
    no_other_keys(fields, {"delimiter", "comment", "decimal"})
    delimiter = str(fields.text("delimiter", ",")) if "delimiter" in fields else ""
    if len(delimiter) > 1 or delimiter in tuple('\n\r"'):
        raise BagError(f"{fields.where}: 'delimiter' should be one character, found {delimiter!r}")
    decimal = fields.text("decimal") if "decimal" in fields else ""
    if decimal not in ("", ".", ","):
        raise BagError(f"{fields.where}: 'decimal' should be '.' or ',', found '{decimal}'")
    comment = fields.text("comment") if "comment" in fields else ""
    return CsvLayout(delimiter, comment, decimal)


def _check_apart(sections: Mapping[str, Mapping[str, LogSignal]], path: Path) -> None:
    """Strokes and joints share a topic, in which a name is one signal."""
    for key in ("joints", "efforts"):
        shared = sorted(set(sections["strokes"]) & set(sections[key]))
        if shared:
            raise BagError(
                f"{path}: expected other names under strokes, those of cylinders, than under"
                f" {key}, found '{shared[0]}' under both: /joint_states would have one of the two"
            )


def _check_names(
    sections: Mapping[str, Mapping[str, LogSignal]], robot: Robot, path: Path
) -> None:
    cylinders = tuple(c.name for c in robot.cylinders)
    known = {
        "strokes": cylinders,
        "pressures": robot.pressure_names,
        "valves": robot.valve_names,
        "valve_commands": robot.valve_names,
        "spools": robot.valve_names,
    }
    for key, signals in sections.items():
        names = known.get(key, robot.joint_names)
        for name in signals:
            if name not in names:
                raise BagError(
                    f"{path}, {key}: robot {robot.name} has no '{name}'"
                    f" (known: {', '.join(names) or 'none'})"
                )
