"""`player`: plays a bag back onto its topics, for machines without rosbag2.

The recorded bytes are published as they are, at the intervals at which they were received.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.bag.definitions import message_class_of
from hydro_ident.bag.mcap_types import Channel
from hydro_ident.bag.playback import Contents, contents_of, messages_in_order
from hydro_ident.errors import BagError
from hydro_model.command_line.command import Parser, run_command, warn
from hydro_model.command_line.output import STDOUT, add_json, report
from hydro_model.command_line.terminal import advance, progress_bar
from hydro_model.description.safe_yaml import UnusableYamlError, parse
from hydro_msgs_docs.endings import stop_on_signals
from hydro_msgs_docs.middleware import start_ros
from hydro_msgs_docs.node_arguments import own_arguments
from hydro_msgs_docs.topics import DIAGNOSTICS, LIVE_DEPTH, reliable

#: Of what `--json` writes.
SCHEMA = "hydro_ident/played/1"
_LEAST_SLEEP_S = 0.0005
#: How often the position is told, and a signal looked for.
_TOLD_EVERY_S = 0.1
_MOST_QOS_CHARACTERS = 100_000
#: Topics on which several publish as a rule.
_EVERYBODYS = frozenset((DIAGNOSTICS, "/rosout", "/parameter_events", "/tf", "/tf_static"))
#: For so long others are looked for: who is there was found by then.
_FOUND_S = 5.0


def main(arguments: Sequence[str] | None = None) -> int:
    """The `player` executable."""
    return run_command("player", _run, arguments)


def _rate(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"expected a rate above 0, found '{text}'")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="player", description="Play a bag (directory or .mcap file) back onto its topics."
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 directory or .mcap file")
    parser.add_argument(
        "--rate", type=_rate, default=1.0, metavar="X", help="times real time (default 1)"
    )
    parser.add_argument("--loop", action="store_true", help="start again at the end")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="play these only")
    parser.add_argument(
        "--delay",
        type=float,
        default=1.0,
        metavar="S",
        help="until the first message (default 1)",
    )
    parser.add_argument(
        "--beside",
        action="store_true",
        help="play although somebody else publishes on a topic, such as a machine that is up",
    )
    add_json(parser, "at the end what was played")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(own_arguments(arguments))
    with progress_bar():
        contents = contents_of(options.bag)
    channels, left_out = chosen_channels(contents.channels, options.topics, options.bag)
    chosen = [topic for topic in contents.topics if topic.channel in channels]
    span_s = (max(t.last_ns for t in chosen) - min(t.first_ns for t in chosen)) * 1e-9

    import rclpy
    from rclpy.signals import SignalHandlerOptions

    with stop_on_signals() as stop:
        start_ros("player", arguments, SignalHandlerOptions.NO)
        try:
            player = Player(channels, alone=not options.beside)
            warn("player", (*contents.damage, *contents.unchecked, *left_out))
            stream = sys.stderr if options.json == STDOUT else sys.stdout
            print(f"playing {len(channels)} topics of {options.bag}", file=stream, flush=True)
            began_s = time.monotonic()
            _sleep(options.delay, stop, player.look)
            with progress_bar():
                while not stop:
                    player.play(options.bag, contents, options.rate, stop, Position(span_s))
                    if not options.loop:
                        break
            player.finish()
        finally:
            rclpy.try_shutdown()
    data = {
        "schema": SCHEMA,
        "bag": str(options.bag),
        "rate": options.rate,
        "seconds": time.monotonic() - began_s,
        "messages": player.count,
        "topics": player.counts,
        "left_out": left_out,
        "damage": list(contents.damage),
        "checksummed": not contents.unchecked,
    }
    report(options.json, data, f"played {player.count} messages")
    return 0


def _sleep(
    seconds: float, stop: Sequence[bool], meanwhile: Callable[[], None] = lambda: None
) -> None:
    """Sleep, but no longer than until a signal, and do something now and then."""
    due_s = time.monotonic() + seconds
    while not stop and (left_s := due_s - time.monotonic()) > _LEAST_SLEEP_S:
        meanwhile()
        time.sleep(min(left_s, _TOLD_EVERY_S))


class Position:
    """Where in the bag the player is, for a bar on a terminal.

    Parameters
    ----------
    span_s : float
        From the first message that is played to the last one.
    """

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._told_s = -math.inf

    def tell(self, at_s: float) -> None:
        """Show a position, now and then.

        Parameters
        ----------
        at_s : float
            From the first message on.
        """
        now_s = time.monotonic()
        if now_s - self._told_s < _TOLD_EVERY_S:
            return
        self._told_s = now_s
        at_s = min(max(at_s, 0.0), self._span_s)
        text = f"at {at_s:.1f} of {self._span_s:.1f} s of the bag"
        advance(text, round(1e3 * at_s), round(1e3 * self._span_s))


def chosen_channels(
    channels: Sequence[Channel], topics: Sequence[str] | None, bag: Path
) -> tuple[list[Channel], list[str]]:
    """The channels that are played.

    Parameters
    ----------
    channels : sequence of Channel
        Of the bag.
    topics : sequence of str, or None
        None for all that can be played. A slash before a name may be left out.
    bag : Path
        For messages.

    Returns
    -------
    channels : list of Channel
    left_out : list of str
        Why others are not played, which nobody asked for by name.

    Raises
    ------
    BagError
        A topic asked for that the bag does not hold or that cannot be played, or no other one.
    """
    there = {channel.topic: channel for channel in channels}
    asked = [topic if topic.startswith("/") else f"/{topic}" for topic in topics or ()]
    absent = [topic for topic in asked if topic not in there]
    if absent:
        raise BagError(f"{bag}: expected a topic {absent[0]}, found {', '.join(sorted(there))}")
    wanted = dict.fromkeys(asked or there)
    unplayable = {t: why for t in wanted if (why := _why_not_played(there[t]))}
    if unplayable and (asked or len(unplayable) == len(wanted)):
        topic, why = next(iter(unplayable.items()))
        raise BagError(f"topic {topic}: {why}")
    left_out = [f"topic {topic}: {why}; not played" for topic, why in unplayable.items()]
    return [there[topic] for topic in wanted if topic not in unplayable], left_out


def _why_not_played(channel: Channel) -> str:
    """Empty where nothing speaks against it."""
    if channel.encoding != "cdr":
        return f"expected encoding cdr, found '{channel.encoding}'"
    try:
        message_class_of(channel.message_type)
    except LookupError as error:
        return str(error)
    return ""


class Player:
    """A publisher per channel.

    Parameters
    ----------
    channels : sequence of Channel
        As of `chosen_channels`.
    alone : bool
        End where somebody else publishes on one of their topics.

    Attributes
    ----------
    counts : dict of str to int
        Messages published per topic.
    """

    def __init__(self, channels: Sequence[Channel], *, alone: bool = True) -> None:
        from rclpy.node import Node
        from rclpy.qos_overriding_options import QoSOverridingOptions

        self.counts = {channel.topic: 0 for channel in channels}
        self._node = Node("player")
        self._publishers: dict[str, Any] = {}
        self._looked_s, self._look_until_s = 0.0, time.monotonic() + _FOUND_S if alone else 0.0
        for channel in channels:
            self._publishers[channel.topic] = self._node.create_publisher(
                message_class_of(channel.message_type),
                channel.topic,
                _profile(channel),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )

    @property
    def count(self) -> int:
        """Messages published."""
        return sum(self.counts.values())

    def play(
        self, bag: Path, contents: Contents, rate: float, stop: Sequence[bool], position: Position
    ) -> None:
        """Publish every message once, at its time.

        Parameters
        ----------
        bag : Path
        contents : Contents
            Of that bag.
        rate : float
        stop : sequence
            Ends early once it is no longer empty.
        position : Position
            Is told how far it is, also while nothing is due.
        """
        begin_s, first_ns = time.monotonic(), None

        def waiting() -> None:
            self.look()
            position.tell(rate * (time.monotonic() - begin_s))

        for channel, log_ns, data in messages_in_order(bag, contents):
            publisher = self._publishers.get(channel.topic)
            if publisher is None:
                continue
            if first_ns is None:
                first_ns = log_ns
            due_s = begin_s + (log_ns - first_ns) * 1e-9 / rate
            _sleep(due_s - time.monotonic(), stop, waiting)
            if stop:
                return
            self.look()
            position.tell((log_ns - first_ns) * 1e-9)
            publisher.publish(data)
            self.counts[channel.topic] += 1

    def look(self) -> None:
        """End where somebody else publishes on a topic that is played.

        A machine's samples and those of a bag, or two bags', would be taken for one another's.

        Raises
        ------
        BagError
        """
        now_s = time.monotonic()
        if now_s - self._looked_s < _TOLD_EVERY_S or now_s > self._look_until_s:
            return
        self._looked_s = now_s
        topics = [one.topic_name for one in self._publishers.values()]
        shared = [t for t in topics if t not in _EVERYBODYS and self._node.count_publishers(t) > 1]
        if shared:
            domain = self._node.context.get_domain_id()
            raise BagError(
                f"expected nobody to publish on what is played, found somebody on"
                f" {', '.join(shared)} in ROS domain {domain}: a machine is up there, or another"
                " bag is played; end that, set another ROS_DOMAIN_ID, choose --topics, or play it"
                " --beside"
            )

    def finish(self) -> None:
        """Wait until subscribers have confirmed the last messages."""
        from rclpy.duration import Duration

        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=1.0))


def _profile(channel: Channel) -> Any:
    """What the recorded publisher offered, as far as the contract's QoS leaves it open."""
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    profile = reliable(LIVE_DEPTH)
    offered = _first_offer(channel)
    if offered.get("durability") in ("transient_local", 1):
        profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    if offered.get("reliability") in ("best_effort", 2):
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
    return profile


def _first_offer(channel: Channel) -> dict[str, Any]:
    try:
        offers = parse(channel.metadata.get("offered_qos_profiles", "")[:_MOST_QOS_CHARACTERS])
    except UnusableYamlError:
        return {}
    first = offers[0] if isinstance(offers, list) and offers else None
    return first if isinstance(first, dict) else {}
