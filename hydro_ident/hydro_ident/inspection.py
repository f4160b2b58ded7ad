"""What is in a bag, as one record that prints as text and as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.channels import channels_of
from hydro_ident.bag.gaps import LongestGap, find_gaps, longest_gap, usual_period_s
from hydro_ident.bag.grid import Topic
from hydro_ident.bag.reader import Bag, log_span_ns
from hydro_ident.bag.recording import Recording, recording_of
from hydro_ident.complaints import complaints_of
from hydro_ident.errors import BagError
from hydro_ident.health import Finding, find_irregularities, pressure_columns
from hydro_model.errors import RobotError
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TopicSummary:
    """One topic.

    Attributes
    ----------
    topic, message_type : str
    count : int
    rate_hz : float or None
        From the usual interval of stamps (of reception where there are no stamps).
    gaps, missing : int
        Gaps between stamps, and messages missing in them; only topics with a steady rate.
    longest_gap : LongestGap or None
        Of the topic's own stamps, from its first one on; None without gaps.
    duplicates, disordered : int
    latency_ms : float
        Largest time from publication to reception.
    """

    topic: str
    message_type: str
    count: int
    rate_hz: float | None
    gaps: int
    missing: int
    longest_gap: LongestGap | None
    duplicates: int
    disordered: int
    latency_ms: float


@dataclass(frozen=True, slots=True)
class Range:
    """Span of one signal.

    Attributes
    ----------
    signal, unit : str
    low, high, mean : float
    """

    signal: str
    unit: str
    low: float
    high: float
    mean: float


@dataclass(frozen=True, slots=True)
class Inspection:
    """Everything that `inspect` says.

    Attributes
    ----------
    bag : str
    robot : str or None
        The robot it was read for; None where the bag names none.
    duration_s : float
    messages : int
    size_bytes : int
    files : int
    compression : list of str
    checksummed, checksum_failed : bool
        The data are under checksums; one of them does not hold.
    cycles : int
    rate_hz : float or None
        Of the cycles.
    topics : list of TopicSummary
    ranges : list of Range
    channels : list of str
        What can be made of it.
    losses : list of dict
        Channels lost, each with its reason.
    damage : list of str
        What could not be read.
    findings : list of Finding
        Irregular signals.
    diagnostics : list of str
        Warnings and errors that nodes gave, each once; not that they waited at start and end.
    metadata : dict
        The project's own; long texts by their size.
    """

    bag: str
    robot: str | None
    duration_s: float
    messages: int
    size_bytes: int
    files: int
    compression: list[str]
    checksummed: bool
    checksum_failed: bool
    cycles: int
    rate_hz: float | None
    topics: list[TopicSummary]
    ranges: list[Range]
    channels: list[str]
    losses: list[dict[str, str]]
    damage: list[str]
    findings: list[Finding]
    diagnostics: list[str]
    metadata: dict[str, str]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"schema": "hydro_ident/inspection/1", **asdict(self)}


def robot_of(bag: Bag, robot: str | None) -> Robot | None:
    """The robot to read a bag for: as asked, else the shipped one that the bag names.

    Parameters
    ----------
    bag : Bag
    robot : str or None

    Returns
    -------
    Robot or None
    """
    if robot is not None:
        return load_robot(robot)
    named = bag.metadata.get("robot")
    # Never a path: what a bag says opens no other file.
    if named not in shipped_robots():
        return None
    try:
        return load_robot(named)
    except RobotError:
        return None


def inspect_bag(bag: Bag, robot: Robot | None, *, strict: bool = False) -> Inspection:
    """Look a bag over.

    Parameters
    ----------
    bag : Bag
        Read with every topic.
    robot : Robot or None
        Without one, only what needs no robot.
    strict : bool
        A bag that is not this robot's is an error, not a line under `damage`.

    Returns
    -------
    Inspection

    Raises
    ------
    BagError
        Where `strict`.
    """
    recording, damage = _recording(bag, robot, strict)
    first_ns, last_ns = log_span_ns(bag)
    lost = [] if recording is None else list(recording.losses)
    channels: list[str] = []
    if recording is not None:
        torque = recording.effort is not None and recording.p_a is None and recording.p_b is None
        gone = {loss.channel for loss in lost}
        every = channels_of(recording.robot, torque=torque)
        channels = [channel for channel in every if channel not in gone]
    return Inspection(
        bag=str(bag.path),
        robot=None if robot is None else robot.name,
        duration_s=(last_ns - first_ns) * 1e-9 if recording is None else recording.duration_s,
        messages=bag.count,
        size_bytes=sum(f.size_bytes for f in bag.files),
        files=len(bag.files),
        compression=sorted({c for f in bag.files for c in f.compression}),
        checksummed=bag.checksummed,
        checksum_failed=bag.checksum_failed,
        cycles=0 if recording is None else len(recording),
        rate_hz=None if recording is None else 1.0 / recording.period_s,
        topics=[_summary(bag, topic) for topic in bag.topics],
        ranges=[] if recording is None else ranges_of(recording),
        channels=channels,
        losses=[{"channel": loss.channel, "reason": loss.reason} for loss in lost],
        damage=damage,
        findings=[] if recording is None else _findings(recording),
        diagnostics=complaints_of(bag.diagnostics),
        metadata={k: v if len(v) <= 200 else f"{len(v)} bytes" for k, v in bag.metadata.items()},
    )


def _recording(bag: Bag, robot: Robot | None, strict: bool) -> tuple[Recording | None, list[str]]:
    if robot is None:
        return None, list(bag.losses)
    try:
        recording = recording_of(bag, robot)
    except BagError as error:
        if strict:
            raise
        return None, [*bag.losses, str(error)]
    # A bag without checksums is not damaged: it has a word of its own.
    return recording, [note for note in recording.notes if note not in bag.unchecked]


def _findings(recording: Recording) -> list[Finding]:
    name = recording.other_robot
    other = f"recorded as '{name}', looked at as {recording.robot.name}"
    return [*([Finding("robot", "other", other)] if name else []), *find_irregularities(recording)]


def _summary(bag: Bag, name: str) -> TopicSummary:
    info = bag.topics[name]
    series = bag.series.get(name)
    gaps, longest, rate_hz, duplicates, disordered = [], None, None, 0, 0
    if series is not None and len(series) > 1:
        topic = Topic.of(series)
        duplicates, disordered = topic.duplicates, topic.disordered
        if len(topic.stamp_ns) > 1:
            period_s = usual_period_s(topic.stamp_ns)
            rate_hz = 1.0 / period_s
            gaps = list(find_gaps(topic.stamp_ns, period_s))
            longest = longest_gap(gaps, int(topic.stamp_ns[0]))
    elif info.count > 1 and info.last_log_ns > info.first_log_ns:
        rate_hz = (info.count - 1) / ((info.last_log_ns - info.first_log_ns) * 1e-9)
    return TopicSummary(
        name,
        info.message_type,
        info.count,
        rate_hz,
        len(gaps),
        sum(gap.missing for gap in gaps),
        longest,
        duplicates,
        disordered,
        info.latency_ns * 1e-6,
    )


def ranges_of(recording: Recording) -> list[Range]:
    """Span of every recorded signal that has a finite sample."""
    robot = recording.robot
    rows: list[tuple[str, str, FloatArray]] = []

    def columns(
        names: Iterable[str], units: Iterable[str], values: FloatArray | None, kind: str
    ) -> None:
        if values is not None:
            for i, (name, unit) in enumerate(zip(names, units, strict=True)):
                rows.append((f"{name} {kind}".strip(), unit, values[:, i]))

    angle = ["m" if joint.prismatic else "rad" for joint in robot.joints]
    torque = ["N" if joint.prismatic else "N m" for joint in robot.joints]
    cylinders = [c.name for c in robot.cylinders]
    columns(robot.joint_names, angle, recording.q, "position")
    columns(cylinders, ["m"] * len(cylinders), recording.stroke, "stroke")
    columns(robot.joint_names, torque, recording.effort, "effort")
    rows += [(n, "Pa gauge", p) for n, p in pressure_columns(recording).items()]
    columns(robot.valve_names, ["V"] * len(robot.valves), recording.valve_v, "voltage")
    columns(robot.valve_names, ["-"] * len(robot.valves), recording.spool, "spool")
    columns("xyz", ["m"] * 3, recording.tip_ref, "tip reference")
    if recording.temperature_c is not None:
        rows.append(("oil temperature", "degC", recording.temperature_c))
    return [
        Range(name, unit, float(np.min(v)), float(np.max(v)), float(np.mean(v)))
        for name, unit, values in rows
        if len(v := values[np.isfinite(values)])
    ]
