"""A log of other people's tools as a bag of the contract, sample by sample.

The log's own time base is the bag's: every line becomes one cycle with the stamp that the log
gives it, nothing is resampled, shifted or filled in. A cell without a value becomes NaN, and a
topic without any value in a line has no message there.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hydro_ident.bag.cdr import FloatArray, IntArray
from hydro_ident.bag.log_file import Log
from hydro_ident.bag.log_map import LogMap, LogSignal
from hydro_ident.bag.metadata import OfferedQos
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import BagError
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    MESSAGE_TYPES,
    OIL_TEMPERATURE,
    VALVE_COMMAND,
    VALVE_STATE,
)

#: Topic -> field of the message -> sections of the mapping whose signals it carries.
_TOPICS: dict[str, dict[str, tuple[str, ...]]] = {
    JOINT_STATES: {"position": ("joints", "strokes"), "effort": ("efforts",)},
    CHAMBER_PRESSURES: {"effort": ("pressures",)},
    VALVE_STATE: {"effort": ("valves",), "position": ("spools",)},
    VALVE_COMMAND: {"effort": ("valve_commands",)},
    JOINT_REFERENCE: {"position": ("references",)},
}


_END_S = 2.0**31


@dataclass(frozen=True, slots=True)
class TopicColumns:
    """What one topic of the bag will carry.

    Attributes
    ----------
    names : tuple of str
    fields : mapping of str to (N, k) array
        NaN where the log has no value.
    """

    names: tuple[str, ...]
    fields: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class Conversion:
    """What was written.

    Attributes
    ----------
    path : Path
    cycles : int
    rate_hz : float
        Of the median interval.
    shortest_s, longest_s : float
        Intervals between two stamps.
    counts : mapping of str to int
        Messages per topic.
    unused : tuple of str
        Signals of the log that the mapping does not name.
    """

    path: Path
    cycles: int
    rate_hz: float
    shortest_s: float
    longest_s: float
    counts: Mapping[str, int]
    unused: tuple[str, ...]


def convert(log: Log, mapping: LogMap, out: str | Path, metadata: Mapping[str, str]) -> Conversion:
    """Write a log as a bag.

    Parameters
    ----------
    log : Log
    mapping : LogMap
    out : str or Path
        Directory of the bag; must not exist.
    metadata : mapping of str to str
        For the bag, beside robot and mapping.

    Returns
    -------
    Conversion

    Raises
    ------
    BagError
        A signal is missing or of another length than the time, time does not increase, there is
        no position, or `out` exists.
    """
    # Numbers beyond a float's range become infinite: judged below, not warned of here.
    with np.errstate(all="ignore"):
        stamps = stamps_of(log, mapping)
        topics = topics_of(log, mapping, len(stamps))
        temperature = _column(log, mapping.oil_temperature, "oil_temperature", len(stamps))
    if Path(out).exists():
        raise BagError(f"{out}: exists already, nothing overwritten")
    kept = {"mapping": mapping.source.read_text(encoding="utf-8"), **metadata}
    if mapping.robot is not None:
        kept["robot"] = mapping.robot.name
    try:
        counts = _write(Path(out), kept, stamps, topics, temperature)
    except BaseException:
        # Half a bag would look like a recording that was cut off.
        shutil.rmtree(out, ignore_errors=True)
        raise
    steps = np.diff(stamps) * 1e-9
    used = {mapping.time.signal} if mapping.time is not None else set()
    used |= {n for section in mapping.sections.values() for s in section.values() for n in s.names}
    used |= {mapping.oil_temperature.signal} if mapping.oil_temperature is not None else set()
    return Conversion(
        path=Path(out),
        cycles=len(stamps),
        rate_hz=float(1.0 / np.median(steps)),
        shortest_s=float(steps.min()),
        longest_s=float(steps.max()),
        counts=counts,
        unused=tuple(name for name in log.columns if name not in used),
    )


def stamps_of(log: Log, mapping: LogMap) -> IntArray:
    """Stamps of the log's samples, ns.

    Parameters
    ----------
    log : Log
    mapping : LogMap

    Returns
    -------
    (N,) int64 array

    Raises
    ------
    BagError
        Fewer than two samples, or a time that is missing, does not increase or is negative.
    """
    if mapping.time is None:
        first = next(s for section in mapping.sections.values() for s in section.values())
        count = len(log.column(first.signal, str(mapping.source)))
        seconds = np.arange(count) / mapping.rate_hz
    else:
        where = f"{mapping.source}, time"
        seconds = mapping.time.values(log.column(mapping.time.signal, where))
    if len(seconds) < 2:
        raise BagError(f"{log.path}: expected at least 2 samples, found {len(seconds)}")
    if not np.isfinite(seconds).all():
        row = int(np.flatnonzero(~np.isfinite(seconds))[0])
        raise BagError(f"{log.path}: sample {row + 1} has no time")
    _check_span(log, mapping.start_ns * 1e-9 + seconds)
    stamps = mapping.start_ns + np.round(seconds * 1e9).astype(np.int64)
    late = np.flatnonzero(np.diff(stamps) <= 0)
    if len(late):
        k = int(late[0])
        raise BagError(
            f"{log.path}: expected a time that increases, found {seconds[k]:.9g} s and then"
            f" {seconds[k + 1]:.9g} s at sample {k + 2}"
        )
    return np.asarray(stamps, dtype=np.int64)


def _check_span(log: Log, seconds: FloatArray) -> None:
    """Stamps are int32 seconds since 1970."""
    if seconds.min() < 0.0:
        raise BagError(f"{log.path}: {-seconds.min():g} s before 1970: give a later 'start'")
    if seconds.max() >= _END_S:
        raise BagError(
            f"{log.path}: expected times before 2038, found {seconds.max():g} s of 1970"
        )


def topics_of(log: Log, mapping: LogMap, count: int) -> dict[str, TopicColumns]:
    """The columns of every topic that the mapping fills.

    Parameters
    ----------
    log : Log
    mapping : LogMap
    count : int
        Number of samples N.

    Returns
    -------
    dict of str to TopicColumns
    """
    topics = {}
    for topic, layout in _TOPICS.items():
        sections = [key for keys in layout.values() for key in keys]
        names = tuple(dict.fromkeys(n for key in sections for n in mapping.sections[key]))
        fields = {
            field: _field(log, mapping, names, keys, count)
            for field, keys in layout.items()
            if any(mapping.sections[key] for key in keys)
        }
        if fields:
            topics[topic] = TopicColumns(names, fields)
    if "position" not in topics.get(JOINT_STATES, TopicColumns((), {})).fields:
        raise BagError(f"{mapping.source}: expected a position under joints or strokes")
    return topics


def _field(
    log: Log, mapping: LogMap, names: Sequence[str], keys: Sequence[str], count: int
) -> FloatArray:
    values = np.full((count, len(names)), np.nan)
    for key in keys:
        for name, signal in mapping.sections[key].items():
            column = _column(log, signal, f"{key}, {name}", count)
            if column is not None:
                values[:, names.index(name)] = column
    return values


def _column(log: Log, signal: LogSignal | None, where: str, count: int) -> FloatArray | None:
    if signal is None:
        return None
    if not signal.names:
        return np.full(count, signal.offset)
    columns = [log.column(name, where) for name in signal.names]
    for name, column in zip(signal.names, columns, strict=True):
        if len(column) != count:
            raise BagError(
                f"{log.path}: expected {count} samples of '{name}' as of the time,"
                f" found {len(column)}"
            )
        if not np.isfinite(column).any():
            raise BagError(f"{log.path}: '{name}' holds no number")
    recorded = columns[0] - columns[1] if signal.minus else columns[0]
    return signal.values(recorded)


def _write(
    out: Path,
    metadata: Mapping[str, str],
    stamps: IntArray,
    topics: Mapping[str, TopicColumns],
    temperature: FloatArray | None,
) -> dict[str, int]:
    with BagWriter(out, metadata) as writer:
        for topic in topics:
            writer.add_topic(topic, MESSAGE_TYPES[topic], qos=(OfferedQos(),))
        if temperature is not None:
            writer.add_topic(OIL_TEMPERATURE, MESSAGE_TYPES[OIL_TEMPERATURE])
        there = {
            topic: np.any([np.isfinite(v).any(axis=1) for v in columns.fields.values()], axis=0)
            for topic, columns in topics.items()
        }
        for k, stamp in enumerate(stamps.tolist()):
            for topic, columns in topics.items():
                if there[topic][k]:
                    values = {field: v[k] for field, v in columns.fields.items()}
                    writer.write_stamped(topic, stamp, values, names=columns.names)
            if temperature is not None and np.isfinite(temperature[k]):
                writer.write_stamped(OIL_TEMPERATURE, stamp, {"temperature": temperature[k]})
        return writer.counts
