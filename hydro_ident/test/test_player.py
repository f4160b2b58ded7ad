"""The player as a process over DDS: the recorded bytes, on their topics, at their intervals."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.playback import contents_of, messages
from hydro_ident.bag.player import chosen_channels, main
from hydro_ident.bag.reader import read_bag
from hydro_ident.errors import BagError

DOMAIN = 10 + (os.getpid() + 30) % 90
N = 400
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 120.0


@pytest.fixture
def node(monkeypatch) -> Iterator[Any]:
    import rclpy
    from rclpy.node import Node

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = Node("player_test", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def _play(path: Path, *arguments: str, **streams: int) -> subprocess.Popen[str]:
    environment = {
        **os.environ,
        "TERM": "xterm",
        "ROS_DOMAIN_ID": str(DOMAIN),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    code = "import sys; from hydro_ident.bag.player import main; sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, "-c", code, str(path), *arguments],
        env=environment,
        text=True,
        **(streams or {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}),
    )


def _play_once_found(
    node: Any, path: Path, topics: Iterable[str], arguments: Sequence[str]
) -> tuple[subprocess.Popen[str], float, float]:
    """A player that was found well before its first message, its start and its delay."""
    for delay_s in (2.0, 8.0, 32.0):
        begin = time.monotonic()
        process = _play(path, "--delay", str(delay_s), *arguments)
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said.startswith("playing "), said
        end = time.monotonic() + 0.5 * delay_s
        while time.monotonic() < end:
            if all(node.count_publishers(topic) == 1 for topic in topics):
                return process, begin, delay_s
            time.sleep(0.02)
        process.kill()
        process.communicate()
    raise AssertionError(f"no player found within {0.5 * delay_s:g} s")


@pytest.mark.ros
def test_a_bag_is_played_byte_by_byte_in_its_time(node, write_bag, run_columns) -> None:
    from geometry_msgs.msg import PointStamped
    from sensor_msgs.msg import JointState

    from hydro_msgs_docs.hot_loop import HotSubscription
    from hydro_msgs_docs.topics import RECORDER_DEPTH, reliable

    path = write_bag(run_columns(N))
    types = {"/joint_states": JointState, "/tip_reference": PointStamped}
    subscriptions = {
        topic: HotSubscription(node, kind, topic, reliable(RECORDER_DEPTH), raw=True)
        for topic, kind in types.items()
    }
    other = HotSubscription(node, JointState, "/valve_state", reliable(RECORDER_DEPTH), raw=True)
    # Nothing is overwritten before this process, should it be kept waiting, has taken it.
    deep = [f"qos_overrides.{topic}.publisher.depth:={N}" for topic in types]
    options = [word for parameter in deep for word in ("-p", parameter)]
    told = path.with_name("told.json")
    arguments = ["--topics", *types, "--rate", "2", "--json", str(told), "--ros-args", *options]
    process, begin, delay_s = _play_once_found(node, path, types, arguments)
    out, _ = process.communicate(timeout=PATIENCE_S)
    elapsed_s = time.monotonic() - begin
    assert process.returncode == 0, out
    assert f"played {2 * N} messages" in out
    data = json.loads(told.read_text())
    assert data["topics"] == dict.fromkeys(types, N)
    assert (data["messages"], data["rate"], data["bag"]) == (2 * N, 2.0, str(path))
    assert (data["damage"], data["checksummed"]) == ([], True)
    assert data["seconds"] >= delay_s + 0.399
    # 0.798 s of log time at twice real time: never faster.
    assert elapsed_s >= delay_s + 0.399
    expected: dict[str, list[bytes]] = {topic: [] for topic in types}
    for channel, _, data in messages(path):
        if channel.topic in expected:
            expected[channel.topic].append(data)
    for topic, subscription in subscriptions.items():
        received = []
        while (data := subscription.take()) is not None:
            received.append(data)
        assert len(received) == N
        assert [a[: len(b)] for a, b in zip(received, expected[topic], strict=True)] == expected[
            topic
        ]
    assert other.take() is None


@pytest.mark.ros
def test_latched_topics_reach_who_comes_later(node, tmp_path) -> None:
    from sensor_msgs.msg import JointState

    from hydro_ident.bag.metadata import OfferedQos
    from hydro_ident.bag.writer import BagWriter
    from hydro_msgs_docs.cdr import JOINT_STATE
    from hydro_msgs_docs.hot_loop import HotSubscription, HotWait
    from hydro_msgs_docs.topics import latched

    with BagWriter(tmp_path / "bag") as writer:
        qos = OfferedQos(depth=1, durability="transient_local")
        writer.add_topic("/base_parameters", JOINT_STATE, qos=[qos])
        writer.add_topic("/joint_states", JOINT_STATE)
        writer.write_stamped("/base_parameters", 1, {"effort": [2.5]}, names=["a.mcx"])
        # Something that lies far ahead keeps the player up.
        writer.write_stamped("/joint_states", 10**10 * 6, {"position": [1.0]}, names=["lift"])
    early = HotSubscription(node, JointState, "/base_parameters", latched())
    process = _play(tmp_path / "bag", "--delay", "0")
    try:
        # Whoever comes once this one has it comes later than the message.
        assert HotWait(node, early).wait(PATIENCE_S)
        late = HotSubscription(node, JointState, "/base_parameters", latched())
        assert HotWait(node, late).wait(PATIENCE_S)
        message = late.take()
        assert message is not None
        assert list(message.effort) == [2.5]
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0


@pytest.mark.ros
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["term", "hup"])
def test_signals_end_it_in_order(write_bag, run_columns, number) -> None:
    process = _play(write_bag(run_columns(N)), "--loop", "--delay", "0")
    assert process.stdout is not None
    assert process.stdout.readline().startswith("playing ")
    process.send_signal(number)
    said, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, said
    assert said.startswith("played ")


@pytest.mark.ros
@pytest.mark.parametrize(
    ("topic", "options", "code"),
    [
        ("/joint_states", (), 2),
        ("/joint_states", ("--beside",), 0),
        ("/joint_states", ("--topics", "/chamber_pressures"), 0),
    ],
)
def test_a_bag_is_not_played_beside_a_machine(
    node, write_bag, run_columns, topic, options, code
) -> None:
    """Whoever listens there takes the bag's samples for the machine's."""
    from sensor_msgs.msg import JointState

    node.create_publisher(JointState, topic, 1)
    process = _play(write_bag(run_columns(N)), "--delay", "6", *options)
    said, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code, said
    refusal = f"found somebody on {topic} in ROS domain {DOMAIN}: a machine is up there"
    assert (refusal in said) == (code == 2)
    assert ("played " in said) == (code == 0)


@pytest.mark.ros
def test_what_cannot_be_played_is_said(
    tmp_path, write_bag, run_columns, without_checksums
) -> None:
    """On standard error and to programs, before the first message; what is left is played."""
    path = write_bag(run_columns(N), compression="lz4")
    without_checksums(path)
    file = path / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    data[data.index(b"lz4") + 4] ^= 0x55
    file.write_bytes(data)
    bag = read_bag(path)
    damage = list(bag.losses)
    assert len(bag.unchecked) == 1
    assert any("left out" in loss for loss in damage)
    told = tmp_path / "told.json"
    process = _play(
        path, "--delay", "0", "--json", str(told), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    out, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, errors
    expected = [*damage, *bag.unchecked]
    assert errors.splitlines() == [f"player: warning: {said}" for said in expected]
    said = json.loads(told.read_text())
    assert (said["damage"], said["checksummed"]) == (damage, False)
    assert 0 < said["messages"] < 6 * N
    assert f"played {said['messages']} messages" in out


def test_a_terminal_sees_where_in_the_bag_the_player_is(write_bag, run_columns) -> None:
    path = write_bag(run_columns(N))
    master, slave = pty.openpty()
    screen = {"stderr": slave, "stdout": subprocess.PIPE}
    process = _play(path, "--delay", "0", "--rate", "0.4", **screen)
    os.close(slave)
    seen = b""
    with suppress(OSError):  # the end of a pseudo-terminal whose other side is closed
        while more := os.read(master, 10_000):
            seen += more
    os.close(master)
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, out
    assert out.startswith("playing 6 topics of ")
    assert f"\nplayed {6 * N} messages" in out
    assert "\x1b" not in out
    places = re.findall(r"] +(\d+)% [^\r]*at ([\d.]+) of ([\d.]+) s of the bag", seen.decode())
    assert {total for _, _, total in places} == {"0.8"}
    at = [float(place) for _, place, _ in places]
    assert at == sorted(at)
    assert len(set(at)) >= 5
    for share, place, _ in places:
        assert float(share) / 100.0 == pytest.approx(float(place) / 0.798, abs=0.1)
    assert seen.endswith(b"\r\x1b[2K")


def test_where_a_topic_begins_and_ends(write_bag, run_columns) -> None:
    contents = contents_of(write_bag(run_columns(250)))
    assert [topic.channel for topic in contents.topics] == list(contents.channels)
    for topic in contents.topics:
        assert topic.last_ns - topic.first_ns == pytest.approx(249 * 2_000_000, rel=0.01)


def test_what_is_played(write_bag, run_columns) -> None:
    path = write_bag(run_columns(5))
    channels = contents_of(path).channels
    assert len(chosen_channels(channels, None, path)[0]) == 6
    for asked in (["/tip_reference"], ["tip_reference", "/tip_reference"]):
        (one,), left_out = chosen_channels(channels, asked, path)
        assert (one.message_type, left_out) == ("geometry_msgs/msg/PointStamped", [])
    with pytest.raises(BagError, match="expected a topic /tf, found /chamber_pressures"):
        chosen_channels(channels, ["/tf"], path)


def test_a_topic_that_cannot_be_played_keeps_no_other_back(write_bag, run_columns) -> None:
    path = write_bag(run_columns(5))
    channels = contents_of(path).channels
    reference, state, *_ = channels
    foreign = replace(reference, topic="/events/write_split", message_type="bag_msgs/msg/Split")
    other = replace(state, topic="/web", encoding="json")
    played, left_out = chosen_channels([*channels, foreign, other], None, path)
    assert played == list(channels)
    assert left_out == [
        "topic /events/write_split: no message type 'bag_msgs/msg/Split' installed; not played",
        "topic /web: expected encoding cdr, found 'json'; not played",
    ]
    with pytest.raises(BagError, match="topic /web: expected encoding cdr, found 'json'"):
        chosen_channels([*channels, other], ["/web"], path)
    with pytest.raises(BagError, match="no message type 'bag_msgs/msg/Split' installed"):
        chosen_channels([foreign, other], None, path)


def test_messages_come_in_order_of_reception(write_bag, run_columns) -> None:
    log_ns = np.array([log_ns for _, log_ns, _ in messages(write_bag(run_columns(250)))])
    assert (np.diff(log_ns) >= 0).all()
    assert len(log_ns) == 1500


def test_bad_input_is_one_line(tmp_path, write_bag, run_columns, capsys) -> None:
    path = str(write_bag(run_columns(5)))
    (tmp_path / "folder").mkdir()
    (tmp_path / "cut.mcap").write_bytes(b"\x89MCAP0\r\n")
    for arguments, text in (
        ([str(tmp_path / "nowhere")], "no bag"),
        ([str(tmp_path / "folder")], "expected a rosbag2 directory"),
        ([path, "--topics", "/tf"], "expected a topic /tf"),
        ([str(tmp_path / "cut.mcap")], "no message in this bag (cut.mcap: cut off"),
    ):
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert text in error
    for bad in ("0", "-1", "nan", "x"):
        with pytest.raises(SystemExit) as usage:
            main([path, "--rate", bad])
        assert usage.value.code == 2
        assert f"expected a rate above 0, found '{bad}'" in capsys.readouterr().err
