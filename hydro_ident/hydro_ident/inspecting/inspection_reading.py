"""A bag looked over from front to end: what `inspect` says of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from hydro_ident.bag.aligned import (
    TYPES,
    Decoded,
    check_topics,
    filled_notes,
    irregular,
    nothing_in_common,
    own_names,
    unused_messages,
    valve_topic,
)
from hydro_ident.bag.channels import Loss, channels_of, find_losses
from hydro_ident.bag.gaps import GapCount
from hydro_ident.bag.intervals import UndecidedError
from hydro_ident.bag.mcap_types import unchecked
from hydro_ident.bag.recorded_run import other_robot
from hydro_ident.bag.stretch_cycles import Known
from hydro_ident.bag.stretches import LATE_S, READINGS, ROWS, Passage, Stretch, look_through
from hydro_ident.bag.valve_columns import commanded_notes
from hydro_ident.errors import BagError
from hydro_ident.inspecting.health import Finding, irregularities
from hydro_ident.inspecting.inspection import Inspection, TopicSummary, ranges_in
from hydro_ident.inspecting.inspection_passes import FirstPass, SecondPass
from hydro_ident.inspecting.named_robot import look_for, named_robot, robot_by_joints
from hydro_ident.inspecting.signal_look import SignalLook
from hydro_model.robot import Robot
from hydro_model.robot_files import shipped_robots
from hydro_msgs_docs.topics import JOINT_STATES

RobotOf = Callable[[Mapping[str, str]], Robot | None]


def inspect_bag(
    path: str | Path,
    robot: Robot | None = None,
    *,
    strict: bool = False,
    folders: Sequence[Path] = (),
    rows: int = ROWS,
    late_s: float = LATE_S,
) -> Inspection:
    """Look a bag over, in memory that does not grow with it.

    Parameters
    ----------
    path : str or Path
        rosbag2 directory or MCAP file.
    robot : Robot, optional
        To read it for; by default the one that it names, or where it names none the shipped one
        whose joints it holds. Without one, only what needs no robot.
    strict : bool
        A bag that is not this robot's is an error, not a line under `damage`.
    folders : sequence of Path
        Where a file of a robot may be that the bag names and that is not shipped.
    rows, late_s
        As of `hydro_ident.bag.stretches.Passage`.

    Returns
    -------
    Inspection

    Raises
    ------
    BagError
        As `read_bag`; where `strict`.
    """
    by_joints = cache(lambda: robot_by_joints(Path(path)))

    def robot_of(metadata: Mapping[str, str]) -> Robot | None:
        if robot is not None:
            return robot
        return named_robot(metadata, folders) if metadata.get("robot") else by_joints()

    reading = _Reading(Path(path), robot_of, strict, rows, late_s)
    try:
        found = reading.inspection(None)
    except UndecidedError:
        # Of the whole every interval is kept apart.
        found = reading.inspection(Known(whole=True))
    if robot is None and not found.metadata.get("robot"):
        return replace(found, robot_by_joints=found.robot is not None)
    if robot is not None or found.robot in shipped_robots():
        return found
    named = look_for(found.metadata, folders)
    if found.robot is None or named.robot is None:
        return replace(found, robot_troubles=named.troubles)
    return replace(found, robot_file=str(named.robot.source))


@dataclass(frozen=True, slots=True)
class _Reading:
    """How a bag is read."""

    path: Path
    robot_of: RobotOf
    strict: bool
    rows: int
    late_s: float

    def inspection(self, known: Known | None) -> Inspection:
        firsts: list[FirstPass] = []

        def begin(known: Known) -> Callable[[Stretch], None]:
            firsts[:] = [FirstPass(known)]
            return firsts[0].add

        passage = self._look_through(begin, known, 1)
        first = firsts[0]
        first.finish()
        error = _refused(passage, first)
        if self.strict and error is not None:
            raise error
        second = self._second(passage, first, None if error is not None else first.signals)
        return _inspection(passage, first, second, error)

    def _second(
        self, passage: Passage, first: FirstPass, signals: SignalLook | None
    ) -> SecondPass:
        """A second passage, over the same messages as the first one."""
        seconds = [SecondPass(first, signals)]

        def begin(_: Known) -> Callable[[Stretch], None]:
            seconds[:] = [SecondPass(first, signals)]
            return seconds[0].add

        if seconds[0].needed:
            again = self._look_through(begin, passage.known, READINGS)
            counts, now = (
                {topic: info.count for topic, info in one.infos.items()}
                for one in (passage, again)
            )
            if now != counts:
                raise BagError(
                    f"{self.path}: expected the {sum(counts.values())} messages of a first"
                    f" reading, found {sum(now.values())} in a second one: the bag changed while"
                    " it was read"
                )
        seconds[0].finish()
        return seconds[0]

    def _look_through(
        self,
        begin: Callable[[Known], Callable[[Stretch], None]],
        known: Known | None,
        reading: int,
    ) -> Passage:
        how = self.rows, self.late_s
        return look_through(self.path, self.robot_of, begin, known, reading, *how)


def _refused(passage: Passage, first: FirstPass) -> BagError | None:
    """Why a bag is no recording of the robot."""
    if first.signals is None:
        return None
    decoded = {
        topic: Decoded(one.message_type, passage.windows[topic].count, one.names, one.malformed[1])
        for topic, one in passage.decoder.builders.items()
    }
    try:
        check_topics(passage.path, passage.infos, decoded, first.signals.robot)
    except BagError as error:
        return error
    return None if first.cycles.count else nothing_in_common(passage.path)


def _inspection(
    passage: Passage, first: FirstPass, second: SecondPass, error: BagError | None
) -> Inspection:
    """What both passages found, in one record."""
    signals = first.signals
    robot = None if signals is None else signals.robot
    look = None if error is not None else signals
    losses = [] if look is None else _losses(passage, first, look)
    not_checked = unchecked(passage.healths)
    infos, healths = passage.infos.values(), passage.healths
    span_ns = max(i.last_log_ns for i in infos) - min(i.first_log_ns for i in infos)
    found = [] if look is None else _findings(passage, first, second, look)
    return Inspection(
        bag=str(passage.path),
        robot=None if robot is None else robot.name,
        duration_s=span_ns * 1e-9 if look is None else look.duration_s,
        messages=sum(info.count for info in infos),
        size_bytes=sum(f.size_bytes for f in healths),
        files=len(healths),
        compression=sorted({c for f in healths for c in f.compression}),
        checksummed=not not_checked,
        checksum_failed=any(f.checksum_failed for f in healths),
        cycles=0 if look is None else look.cycles,
        # A lone cycle has no rate: what it would be is the robot file's.
        rate_hz=1.0 / first.period_s(look.robot) if look and look.cycles > 1 else None,
        topics=[_summary(passage, first, second, topic) for topic in passage.infos],
        ranges=[] if look is None else ranges_in(look),
        channels=[] if look is None else _channels(look, losses),
        losses=[{"channel": loss.channel, "reason": loss.reason} for loss in losses],
        damage=_damage(passage, look, error),
        findings=found,
        diagnostics=first.complaints.told(),
        metadata={
            k: v if len(v) <= 200 else f"{len(v)} bytes" for k, v in passage.metadata.items()
        },
    )


def _damage(passage: Passage, look: SignalLook | None, error: BagError | None) -> list[str]:
    """What could not be read, and what is irregular about the topics of the cycles."""
    damage = list(dict.fromkeys(passage.notes))
    if error is not None:
        return [*damage, str(error)]
    if look is None or passage.maker is None:
        return damage
    # A bag without checksums is not damaged: it has a word of its own.
    bare = unchecked(passage.healths)
    there = {name: passage.windows[name] for name in TYPES if name in passage.windows}
    return [
        *(note for note in damage if note not in bare),
        *irregular({name: window.repeats for name, window in there.items()}),
        *filled_notes(look.robot, passage.maker.filled.values()),
        *commanded_notes(passage.maker.commanded, _known_valves(look)),
    ]


def _known_valves(look: SignalLook) -> list[str]:
    """Valves with a voltage, of whichever topic."""
    there = look.columns("valve_v") or [False] * len(look.robot.valve_names)
    return [name for name, known in zip(look.robot.valve_names, there, strict=True) if known]


def _losses(passage: Passage, first: FirstPass, look: SignalLook) -> tuple[Loss, ...]:
    source = "" if passage.maker is None else passage.maker.valve_source
    there = {topic for topic, window in passage.windows.items() if window.count}
    topic = valve_topic(source, there)
    return find_losses(
        look.robot,
        look.present(first.period_s(look.robot)),
        valve_source=source,
        valve_there=topic,
        valve_stamps=first.meetings[topic].wrong(topic, look.cycles) if topic else "",
        dead=look.hidden,
    )


def _channels(look: SignalLook, losses: Sequence[Loss]) -> list[str]:
    """What can be made of the recording."""
    wet = look.columns("p_a") is not None or look.columns("p_b") is not None
    gone = {loss.channel for loss in losses}
    every = channels_of(look.robot, torque=look.columns("effort") is not None and not wet)
    return [channel for channel in every if channel not in gone]


def _findings(
    passage: Passage, first: FirstPass, second: SecondPass, look: SignalLook
) -> list[Finding]:
    name = other_robot(passage.metadata, look.robot)
    other = f"recorded as '{name}', looked at as {look.robot.name}"
    if second.readings is None or passage.maker is None:
        return []
    ends = passage.maker.ends
    found = irregularities(look, second.readings, second.cycle_gaps, look.hidden, ends)
    return [
        *([Finding("robot", "other", other)] if name else []),
        *found,
        *_unused(passage, first, look),
    ]


def _unused(passage: Passage, first: FirstPass, look: SignalLook) -> list[Finding]:
    """Messages that make no cycle, as another topic comes slower."""
    joints = passage.decoder.builders.get(JOINT_STATES)
    # Stamps of others on the topic say nothing of the rate of the robot's.
    if joints is None or not own_names(look.robot).issuperset(joints.names) or look.cycles < 2:
        return []
    periods_s = {t: s.intervals.period_s for t, s in first.stamps.items() if s.count > 1}
    told = unused_messages(periods_s, first.period_s(look.robot))
    return [Finding(topic, "unused", text) for topic, text in told.items()]


def _summary(passage: Passage, first: FirstPass, second: SecondPass, name: str) -> TopicSummary:
    info, window = passage.infos[name], passage.windows.get(name)
    gaps, longest, rate_hz, duplicates, disordered = GapCount(), None, None, 0, 0
    if window is not None and window.count > 1:
        duplicates, disordered = window.repeats.duplicates, window.repeats.disordered
        stamps = first.stamps[name]
        if name in second.gaps:
            rate_hz, gaps = 1.0 / stamps.intervals.period_s, second.gaps[name]
            longest = gaps.told(stamps.first_ns)
    elif info.count > 1 and info.last_log_ns > info.first_log_ns:
        rate_hz = (info.count - 1) / ((info.last_log_ns - info.first_log_ns) * 1e-9)
    return TopicSummary(
        name,
        info.message_type,
        info.count,
        rate_hz,
        gaps.count,
        gaps.missing,
        longest,
        duplicates,
        disordered,
        info.latency_ns * 1e-6,
    )
