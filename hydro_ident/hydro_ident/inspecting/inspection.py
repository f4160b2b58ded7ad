"""What is in a bag, as one record that prints as text and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from hydro_ident.bag.gaps import LongestGap
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.inspecting.health import Finding
from hydro_ident.inspecting.signal_look import SignalLook, look_at


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
        The robot it was read for; None where the bag names none and no shipped one fits.
    duration_s : float
    messages : int
    size_bytes : int
    files : int
    compression : list of str
    checksummed, checksum_failed : bool
        The data are under checksums; one of them does not hold.
    cycles : int
    rate_hz : float or None
        Of the cycles; None of fewer than two.
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
    robot_file : str or None
        In which the robot was found that the bag names, where it is none that is shipped.
    robot_troubles : tuple of str
        Where none was found: what is wrong with files that have its name in it, or may have.
    robot_by_joints : bool
        The bag names no robot: it is the shipped one whose joints are in it.
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
    robot_file: str | None = None
    robot_troubles: tuple[str, ...] = ()
    robot_by_joints: bool = False

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"schema": "hydro_ident/inspection/1", **asdict(self)}


def ranges_of(recording: Recording) -> list[Range]:
    """Span of every recorded signal that has a finite sample."""
    return ranges_in(look_at(recording))


def ranges_in(look: SignalLook) -> list[Range]:
    """As `ranges_of`, of signals that were looked at."""
    return [
        Range(name, unit, float(spans.low[i]), float(spans.high[i]), float(spans.mean[i]))
        for name, unit, kind, i in _signals(look)
        if (spans := look.spans[kind]).finite[i]
    ]


def _signals(look: SignalLook) -> Iterator[tuple[str, str, str, int]]:
    """Name, unit, field and column of every signal that was recorded."""
    robot = look.robot
    angle = ["m" if joint.prismatic else "rad" for joint in robot.joints]
    torque = ["N" if joint.prismatic else "N m" for joint in robot.joints]
    cylinders = [c.name for c in robot.cylinders]
    before = (
        ("q", "position", robot.joint_names, angle),
        ("stroke", "stroke", cylinders, ["m"] * len(cylinders)),
        ("effort", "effort", robot.joint_names, torque),
    )
    volts, shares = ["V"] * len(robot.valves), ["-"] * len(robot.valves)
    behind = (
        ("valve_v", "voltage", robot.valve_names, volts),
        ("spool", "spool", robot.valve_names, shares),
        ("tip_ref", "tip reference", tuple("xyz"), ["m"] * 3),
        ("temperature_c", "oil temperature", ("",), ["degC"]),
    )
    for kind, what, names, units in before:
        for i, told in enumerate(look.columns(kind) or ()):
            if told:
                yield f"{names[i]} {what}", units[i], kind, i
    yield from ((name, "Pa gauge", kind, i) for name, kind, i in look.pressures())
    for kind, what, names, units in behind:
        for i, told in enumerate(look.columns(kind) or ()):
            if told:
                yield f"{names[i]} {what}".strip(), units[i], kind, i
