"""The mapping of a log: which signal is which joint, pressure or valve, and in which unit.

``value = sign * scale * (signal - minus, in its unit) + offset``, the offset in SI units, as in
the mapping of a bus; `minus` is another signal, where the log has no difference of the two. The
page `log_map` of hydro_msgs_docs has every key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from hydro_ident.bag.cdr import FloatArray
from hydro_ident.bag.log_file import CsvLayout
from hydro_ident.errors import BagError
from hydro_model.errors import RobotError
from hydro_model.fields import Fields
from hydro_model.robot import Robot
from hydro_model.robot_files import is_file, load_robot, read_yaml

SCHEMA = "hydro_ident/log_map/1"
ATMOSPHERE_PA = 101325.0
_DEGREE = math.pi / 180.0

#: Units by quantity: factor to SI.
UNITS: dict[str, dict[str, float]] = {
    "position": {"rad": 1.0, "deg": _DEGREE, "mrad": 1e-3, "m": 1.0, "mm": 1e-3},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "effort": {"N m": 1.0, "kN m": 1e3, "N": 1.0, "kN": 1e3},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757293168361},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "ratio": {"1": 1.0, "%": 1e-2},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "temperature": {"degC": 1.0},
}
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
_KEYS = frozenset(
    {"schema", "robot", "time", "start", "csv", "atmospheric_pressure_pa", "oil_temperature"}
)


@dataclass(frozen=True, slots=True)
class LogSignal:
    """A signal of the log as a quantity, SI.

    Attributes
    ----------
    signal : str
        Name in the log; empty: a constant, `offset`.
    factor, offset : float
        ``value = factor * (recorded - minus) + offset``; of a pressure: absolute.
    minus : str
        Name in the log of the signal that is taken off first; empty: none is.
    """

    signal: str
    factor: float
    offset: float
    minus: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Signals of the log that it takes."""
        return tuple(name for name in (self.signal, self.minus) if name)

    def values(self, recorded: FloatArray) -> FloatArray:
        """The quantity from the recorded numbers."""
        return np.asarray(self.factor * recorded + self.offset)


@dataclass(frozen=True, slots=True)
class LogMap:
    """A mapping that was read.

    Attributes
    ----------
    source : Path
    robot : Robot or None
        Where the mapping names one: its names are the only ones allowed.
    time : LogSignal or None
    rate_hz : float
        Of a log without time; 0 where `time` is given.
    start_ns : int
        Stamp of time 0.
    sections : mapping of str to mapping of str to LogSignal
        By the keys of `SECTIONS`, then by the name on the topic.
    oil_temperature : LogSignal or None
    layout : CsvLayout
    """

    source: Path
    robot: Robot | None
    time: LogSignal | None
    rate_hz: float
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
        Missing, malformed, with unknown keys or units, or naming what its robot does not have.
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
    _no_other_keys(top, _KEYS | set(SECTIONS))
    robot = load_robot(_robot_path(top.text("robot"), path)) if "robot" in top else None
    given = ATMOSPHERE_PA if robot is None else robot.atmospheric_pressure_pa
    atmosphere = top.positive("atmospheric_pressure_pa", given)
    time, rate_hz = _time(top.fields("time"))
    sections = {
        key: {
            name: _signal(block.fields(name), quantity, atmosphere)
            for name, block in _entries(top, key)
        }
        for key, quantity in SECTIONS.items()
    }
    if not any(sections.values()):
        raise BagError(f"{path}: expected signals under {', '.join(SECTIONS)}, found none")
    if robot is not None:
        _check_names(sections, robot, path)
    oil = top.optional_fields("oil_temperature")
    return LogMap(
        source=path,
        robot=robot,
        time=time,
        rate_hz=rate_hz,
        start_ns=_start_ns(top),
        sections=sections,
        oil_temperature=None if oil is None else _signal(oil, "temperature", 0.0),
        layout=_layout(top.fields("csv", {})),
    )


def _robot_path(name: str, path: Path) -> str:
    """A robot file beside the mapping, or else as `load_robot` takes it."""
    beside = path.parent / name
    return str(beside) if is_file(beside) else name


def _entries(top: Fields, key: str) -> list[tuple[str, Fields]]:
    block = top.optional_fields(key)
    return [] if block is None else [(name, block) for name in block.keys()]  # noqa: SIM118


def _time(fields: Fields) -> tuple[LogSignal | None, float]:
    if "rate_hz" in fields:
        _no_other_keys(fields, {"rate_hz"})
        return None, fields.positive("rate_hz")
    _no_other_keys(fields, {"signal", "unit"})
    return LogSignal(fields.text("signal"), _unit(fields, "time"), 0.0), 0.0


def _signal(fields: Fields, quantity: str, atmosphere_pa: float) -> LogSignal:
    if "constant" in fields:
        _no_other_keys(fields, {"constant", "unit"})
        return LogSignal("", 0.0, fields.number("constant") * _unit(fields, quantity))
    allowed = {"signal", "minus", "unit", "scale", "offset", "sign"}
    _no_other_keys(fields, allowed | ({"reference"} if quantity == "pressure" else set()))
    sign = fields.number("sign", 1.0)
    if sign not in (1.0, -1.0):
        raise BagError(f"{fields.where}: 'sign' should be 1 or -1, found {sign:g}")
    offset = fields.number("offset", 0.0)
    if quantity == "pressure":
        reference = fields.text("reference")
        if reference not in ("gauge", "absolute"):
            raise BagError(
                f"{fields.where}: 'reference' should be gauge or absolute, found '{reference}'"
            )
        offset += atmosphere_pa if reference == "gauge" else 0.0
    factor = sign * fields.number("scale", 1.0) * _unit(fields, quantity)
    minus = fields.text("minus") if "minus" in fields else ""
    return LogSignal(fields.text("signal"), factor, offset, minus)


def _unit(fields: Fields, quantity: str) -> float:
    units = UNITS[quantity]
    name = fields.text("unit", next(iter(units)))
    if name not in units:
        raise BagError(
            f"{fields.where}: 'unit' should be one of {', '.join(units)}, found '{name}'"
        )
    return units[name]


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
    _no_other_keys(fields, {"delimiter", "comment"})
    layout = CsvLayout()
    delimiter = str(fields.text("delimiter", ",")) if "delimiter" in fields else ""
    if len(delimiter) > 1 or delimiter in tuple('\n\r"'):
        raise BagError(f"{fields.where}: 'delimiter' should be one character, found {delimiter!r}")
    return CsvLayout(delimiter, fields.text("comment", layout.comment))


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


def _no_other_keys(fields: Fields, allowed: set[str] | frozenset[str]) -> None:
    strange = set(fields.keys()) - allowed
    if strange:
        expected, found = ", ".join(sorted(allowed)), min(strange)
        raise BagError(f"{fields.where}: unknown key '{found}' (known: {expected})")
