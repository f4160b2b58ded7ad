"""A log of other people's tools as a bag of the contract, sample by sample.

The log's own time base is the bag's: every instant becomes one cycle with the stamp that the log
gives it, nothing is resampled or filled in. A cell without a value becomes NaN, and a topic
without any value at an instant has no message there.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hydro_ident.bag.metadata import OfferedQos
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import BagError
from hydro_ident.logs.clocks import timeline_of
from hydro_ident.logs.columns import Columns
from hydro_ident.logs.file import Log
from hydro_ident.logs.map import OF_JOINTS, LogMap
from hydro_ident.logs.plausible import rate_warning, unit_warnings
from hydro_ident.logs.unpaired import check_times
from hydro_model.arrays import FloatArray, IntArray
from hydro_model.command_line.output import unwritable
from hydro_model.command_line.terminal import advance
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    MESSAGE_TYPES,
    OIL_TEMPERATURE,
    VALVE_COMMAND,
    VALVE_STATE,
)

#: Topic -> field of the message -> sections of the mapping whose signals it carries; read in this
#: order: the turn of a reference is that of its joint.
_TOPICS: dict[str, dict[str, tuple[str, ...]]] = {
    JOINT_STATES: {"position": ("joints", "strokes"), "effort": ("efforts",)},
    CHAMBER_PRESSURES: {"effort": ("pressures",)},
    VALVE_STATE: {"effort": ("valves",), "position": ("spools",)},
    VALVE_COMMAND: {"effort": ("valve_commands",)},
    JOINT_REFERENCE: {"position": ("references",)},
}


#: Cycles between two words on progress.
_SAID_EVERY = 500
#: Share of cycles with a value of every signal below which the rates differ.
_RARE = 0.75
_SEVERAL = (
    "only {} of {} cycles have a value of every signal: several rates; the analysis takes the rest"
    " for gaps, time: {{keep: common}} leaves them out"
)


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
    remarks : tuple of str
        How the file was read, and what was done to times and values.
    warnings : tuple of str
        What cannot be as the mapping says: the bag has it all the same.
    """

    path: Path
    cycles: int
    rate_hz: float
    shortest_s: float
    longest_s: float
    counts: Mapping[str, int]
    unused: tuple[str, ...]
    remarks: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """For `--json`."""
        return {
            "bag": str(self.path),
            "cycles": self.cycles,
            "rate_hz": self.rate_hz,
            "intervals_s": [self.shortest_s, self.longest_s],
            "messages": dict(self.counts),
            "not_in_the_mapping": list(self.unused),
            "remarks": list(self.remarks),
            "warnings": list(self.warnings),
        }


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
        A signal is missing, of another length than its time or in just the lines of another one,
        time does not increase, there is no position, or `out` exists.
    """
    if Path(out).exists():
        raise BagError(f"{out}: exists already, nothing overwritten")
    # Numbers beyond a float's range become infinite: judged where they are used, not warned of.
    with np.errstate(all="ignore"):
        timeline = timeline_of(log, mapping)
        columns = Columns(log, mapping, timeline)
        topics = topics_of(columns)
        temperature = columns.of(mapping.oil_temperature, "oil_temperature", "temperature")
        odd = check_times(log, mapping, columns.used)
    stamps, topics, temperature, remark = _kept(mapping, timeline.stamps_ns, topics, temperature)
    efforts = {t: [c.fields["effort"]] for t, c in topics.items() if "effort" in c.fields}
    kept = {"mapping": mapping.source.read_text(encoding="utf-8"), **metadata}
    if mapping.robot is not None:
        kept["robot"] = mapping.robot.name
    try:
        counts = _write(Path(out), kept, stamps, topics, temperature)
    except BaseException as error:
        # Half a bag would look like a recording that was cut off.
        shutil.rmtree(out, ignore_errors=True)
        if isinstance(error, OSError):
            raise BagError(unwritable(Path(out), error)) from error
        raise
    steps = np.diff(stamps) * 1e-9
    period_s = float(np.median(steps))
    odd_rate = rate_warning(mapping.robot, period_s)
    return Conversion(
        path=Path(out),
        cycles=len(stamps),
        rate_hz=1.0 / period_s,
        shortest_s=float(steps.min()),
        longest_s=float(steps.max()),
        counts=counts,
        unused=tuple(name for name in log.columns if name not in columns.used),
        remarks=(*log.notes, *timeline.remarks, *columns.remarks, *odd, *remark),
        warnings=(
            *timeline.warnings,
            *columns.warnings,
            *unit_warnings(mapping.robot, efforts),
            *([f"time: {odd_rate}"] if odd_rate else []),
        ),
    )


def topics_of(columns: Columns) -> dict[str, TopicColumns]:
    """The columns of every topic that the mapping fills.

    Parameters
    ----------
    columns : Columns

    Returns
    -------
    dict of str to TopicColumns

    Raises
    ------
    BagError
        No position is among them, or a signal is not as the mapping says.
    """
    topics, sections = {}, columns.mapping.sections
    for topic, layout in _TOPICS.items():
        keys = [key for keys in layout.values() for key in keys]
        names = tuple(dict.fromkeys(n for key in keys for n in sections[key]))
        fields = {
            field: _field(columns, names, field, keys)
            for field, keys in layout.items()
            if any(sections[key] for key in keys)
        }
        if fields:
            topics[topic] = TopicColumns(names, fields)
    if "position" not in topics.get(JOINT_STATES, TopicColumns((), {})).fields:
        raise BagError(f"{columns.mapping.source}: expected a position under joints or strokes")
    return topics


def _field(columns: Columns, names: Sequence[str], field: str, keys: Sequence[str]) -> FloatArray:
    values = np.full((columns.count, len(names)), np.nan)
    for key in keys:
        for name, signal in columns.mapping.sections[key].items():
            joint = name if key in OF_JOINTS else ""
            column = columns.of(signal, f"{key}, {name}", field, joint)
            if column is not None:
                values[:, names.index(name)] = column
    return values


def _kept(
    mapping: LogMap,
    stamps: IntArray,
    topics: dict[str, TopicColumns],
    temperature: FloatArray | None,
) -> tuple[IntArray, dict[str, TopicColumns], FloatArray | None, list[str]]:
    """All cycles, or those at which every signal has a value."""
    values = [v for columns in topics.values() for v in columns.fields.values()]
    # A column that the other section of its topic fills is empty everywhere.
    full = [np.isfinite(v[:, np.isfinite(v).any(axis=0)]).all(axis=1) for v in values]
    whole = np.logical_and.reduce(full)
    count = int(whole.sum())
    if not mapping.common:
        several = count < _RARE * len(whole)
        return stamps, topics, temperature, [_SEVERAL.format(count, len(whole))] * several
    if count < 2:
        raise BagError(
            f"{mapping.source}: keep: common leaves {count} of {len(whole)} cycles: expected"
            " instants at which all signals have values; time: {within_s: ...} widens an instant"
        )
    cut = {
        topic: TopicColumns(c.names, {f: v[whole] for f, v in c.fields.items()})
        for topic, c in topics.items()
    }
    left = f"keep: common: {len(whole) - count} cycles without a value of every signal left out"
    return stamps[whole], cut, None if temperature is None else temperature[whole], [left]


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
            if not k % _SAID_EVERY:
                advance("writing cycles", k, len(stamps))
            for topic, columns in topics.items():
                if there[topic][k]:
                    values = {field: v[k] for field, v in columns.fields.items()}
                    writer.write_stamped(topic, stamp, values, names=columns.names)
            if temperature is not None and np.isfinite(temperature[k]):
                writer.write_stamped(OIL_TEMPERATURE, stamp, {"temperature": temperature[k]})
        return writer.counts
