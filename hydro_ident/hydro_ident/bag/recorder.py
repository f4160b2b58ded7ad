"""`recorder`: records the topics of the contract into a bag, for machines without rosbag2.

Raw bytes go from the middleware to the file; nothing is decoded on the way.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from hydro_ident.bag.definitions import TYPE_HASHES, definition_of_class, message_class_of
from hydro_ident.bag.metadata import OfferedQos, bag_directory
from hydro_ident.bag.provenance import project_metadata
from hydro_ident.bag.publisher_numbers import PublisherNumbers
from hydro_ident.bag.recorder_summary import (
    SLOW_S,
    nothing_heard,
    summary,
    summary_dict,
)
from hydro_ident.bag.recorder_topics import check_topic, wanted_topics
from hydro_ident.bag.running_nodes import RunningNodes
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import IdentError
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import STDOUT, add_json, write_json
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.aside import unread_streams
from hydro_msgs_docs.endings import stop_on_signals
from hydro_msgs_docs.middleware import start_ros
from hydro_msgs_docs.node_arguments import own_arguments
from hydro_msgs_docs.topics import (
    BASE_PARAMETERS,
    RECORDER_DEPTH,
    latched,
    reliable,
)

#: After a wake-up messages are left to gather this long: fewer wake-ups, the same log times.
_GATHER_S = 0.004
#: Messages of one topic that are written before the next topic has its turn.
_TURN = 200
#: Wake-ups where nothing comes: a chunk is closed by so much later than it should.
_WAKE_S = 0.05
#: After so long without any message an operator is told.
_PATIENCE_S = 5.0


class RecordError(IdentError):
    """A recording that could not go on (exit code 1)."""

    exit_code = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """The `recorder` executable: it records on, whoever does not read what it says."""
    with unread_streams():
        return run_command("recorder", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="recorder",
        description="Record topics into DIR/YYYYMMDD-HHMMSS_NAME (rosbag2, MCAP) until Ctrl-C.",
    )
    parser.add_argument(
        "--out", type=Path, default=Path(), metavar="DIR", help="gets the bag (default: here)"
    )
    parser.add_argument("--name", default="run", help="last part of the bag's name (default run)")
    parser.add_argument(
        "--robot", default="xs031", help="robot file or shipped robot (default xs031)"
    )
    parser.add_argument("--note", default="", help="the operator's note, kept in the bag")
    parser.add_argument(
        "--attach",
        action="append",
        default=[],
        metavar="KEY=FILE",
        help="keep a text file in the bag's metadata, as mapping=xs031.mapping.yaml",
    )
    parser.add_argument(
        "--topics",
        nargs="+",
        metavar="TOPIC[:TYPE]",
        help="record these only; TYPE (package/msg/Name) for topics outside the contract",
    )
    parser.add_argument(
        "--compression",
        choices=("zstd", "lz4", "none"),
        default="zstd",
        help="of the bag's chunks (default zstd)",
    )
    add_json(parser, "at the end what was recorded and lost")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(own_arguments(arguments))
    robot = load_robot(options.robot, narrow=True)
    topics = wanted_topics(options.topics, robot)
    metadata = project_metadata(robot, options.note, options.attach)
    for topic, message_type in topics.items():
        check_topic(topic, message_type)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    with stop_on_signals() as stop:
        start_ros("recorder", arguments, SignalHandlerOptions.NO)
        try:
            # Only now: arguments that ROS refuses leave no bag.
            directory = bag_directory(options.out, options.name)
            writer = BagWriter(directory, metadata, compression=options.compression)
            _record(writer, topics, stop, options.json)
        finally:
            rclpy.try_shutdown()
    return 0


def _record(
    writer: BagWriter, topics: Mapping[str, str], stop: Sequence[bool], json_file: Path | None
) -> None:
    stream = sys.stderr if json_file == STDOUT else sys.stdout
    started = time.monotonic()
    nodes = RunningNodes(writer.metadata)
    try:
        recorder = Recorder(writer, topics, stream)
        _tell(f"recording {len(topics)} topics to {writer.directory}", stream)
        recorder.spin(stop, nodes)
        nodes.close()
        if learnt := nodes.learnt():
            writer.add_metadata(learnt)
        writer.close()
    except OSError as error:
        writer.abandon()
        raise RecordError(
            f"{writer.directory}: recording ended after {time.monotonic() - started:.1f} s:"
            f" {error.strerror}; what was written before is readable"
        ) from error
    finally:
        nodes.close()
        writer.close()
    seconds = time.monotonic() - started
    _tell(summary(writer, recorder.lost, seconds), stream)
    if json_file is not None:
        write_json(json_file, summary_dict(writer, recorder.lost, seconds))


def _tell(text: str, stream: TextIO) -> None:
    """Print; nobody who listens, or a full disk under the log, is no reason not to record."""
    with suppress(OSError):
        print(text, file=stream, flush=True)


@dataclass(slots=True)
class _Source:
    """One subscribed topic."""

    topic: str
    message_type: str
    message_class: Any
    hot: Any
    announced: bool = False
    numbers: PublisherNumbers = field(default_factory=PublisherNumbers)


class Recorder:
    """The node: one raw subscription per topic, drained into a `BagWriter`.

    Parameters
    ----------
    writer : BagWriter
    topics : mapping of str to str
        Topic -> message type.
    stream : file
        Told of topics that are received.

    Attributes
    ----------
    lost : dict of str to int
        Messages per topic that publishers numbered but the middleware did not deliver: at least
        so many where several publish on it.
    """

    def __init__(self, writer: BagWriter, topics: Mapping[str, str], stream: TextIO) -> None:
        from rclpy.node import Node

        from hydro_msgs_docs.hot_loop import HotSubscription, HotWait

        self._writer, self._stream = writer, stream
        self.lost: dict[str, int] = {}
        self._said_slow = False
        self._silent_at_s = time.monotonic() + _PATIENCE_S
        self._node = Node("recorder")
        self._sources = []
        for topic, message_type in topics.items():
            qos = latched if topic == BASE_PARAMETERS else reliable
            message_class = message_class_of(message_type)
            hot = HotSubscription(self._node, message_class, topic, qos(RECORDER_DEPTH), raw=True)
            self._sources.append(_Source(topic, message_type, message_class, hot))
        self._wait = HotWait(self._node, *(source.hot for source in self._sources))

    def spin(self, stop: Sequence[bool], nodes: RunningNodes) -> None:
        """Record until `stop` is no longer empty; what has arrived by then is kept.

        Parameters
        ----------
        stop : sequence
        nodes : RunningNodes
            What they say of themselves is kept, too.
        """
        while not stop:
            if self._wait.wait(_WAKE_S):
                self._drain()
                time.sleep(_GATHER_S)
            else:
                self._writer.flush_older_than(time.time_ns())
                self._say_silent()
            self._say_slow()
            if learnt := nodes.learnt():
                self._writer.add_metadata(learnt)
        self._drain(RECORDER_DEPTH, time.time_ns())

    def _say_silent(self) -> None:
        """Once, where nothing at all has come: at the end of a run it would be too late."""
        if time.monotonic() < self._silent_at_s or any(s.announced for s in self._sources):
            return
        self._silent_at_s = math.inf
        _tell(nothing_heard(), self._stream)

    def _say_slow(self) -> None:
        if self._writer.slowest_s > SLOW_S and not self._said_slow:
            self._said_slow = True
            slowest_s = self._writer.slowest_s
            text = f"recorder: slow disk, {slowest_s:.1f} s for a chunk of 0.2 s"
            with suppress(OSError):
                print(text, file=sys.stderr, flush=True)

    def _drain(self, most: int = _TURN, until_ns: int | None = None) -> None:
        """Write what waits; on a slow disk more comes meanwhile, so there is an end to a turn."""
        for source in self._sources:
            subscription = source.hot.subscription
            handle = subscription.handle
            with handle:
                for _ in range(most):
                    taken = handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    log_ns = self._keep(source, taken[0], taken[1])
                    if until_ns is not None and log_ns > until_ns:
                        break
            # A turn may be long, as when a topic is met first: the chunk does not wait for all.
            self._writer.flush_older_than(time.time_ns())

    def _keep(self, source: _Source, data: bytes, info: Mapping[str, Any]) -> int:
        """Write a message; when it was received, ns."""
        if not source.announced:
            self._announce(source)
        missing = source.numbers.missing_before(
            info.get("publication_sequence_number") or 0,
            lambda: self._node.count_publishers(source.topic),
        )
        if missing:
            self.lost[source.topic] = self.lost.get(source.topic, 0) + missing
        log_ns = info.get("received_timestamp") or time.time_ns()
        self._writer.write(source.topic, data, log_ns, info.get("source_timestamp") or log_ns)
        return int(log_ns)

    def _announce(self, source: _Source) -> None:
        source.announced = True
        # Discovery is complete for this topic only now: scripts and operators wait for it.
        _tell(f"receiving {source.topic}", self._stream)
        endpoints = self._node.get_publishers_info_by_topic(source.topic)
        qos = [_offered(e.qos_profile) for e in endpoints]
        known = source.message_type in TYPE_HASHES
        hashes = [str(e.topic_type_hash) for e in endpoints]
        self._writer.add_topic(
            source.topic,
            source.message_type,
            qos=qos or [OfferedQos()],
            text=None if known else definition_of_class(source.message_class),
            type_hash=hashes[0] if hashes else None,
        )


def _offered(profile: Any) -> OfferedQos:
    """Discovery carries neither history nor depth: rosbag2 writes them as unknown and 0, too."""
    return OfferedQos(
        depth=int(profile.depth),
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        history=profile.history.name.lower(),
    )
