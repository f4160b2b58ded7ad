"""The recorder as a process over DDS: everything is kept, a kill costs at most 0.3 s."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_ident.bag.reader import read_bag
from hydro_ident.errors import BagError
from hydro_ident.study.faults.waiting import longest_wait_ms, threads_waited_ns

DOMAIN = 10 + (os.getpid() + 40) % 90
START_NS = 10**18
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 120.0
CYCLE_TOPICS = ("/joint_states", "/chamber_pressures", "/valve_command", "/valve_state")


@pytest.fixture
def node(monkeypatch) -> Iterator[Any]:
    import rclpy
    from rclpy.node import Node

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = Node("recorder_test", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def recorder(tmp_path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts the recorder and waits until it records; what it says goes to `said.txt`."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(DOMAIN),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        code = "import sys; from hydro_ident.bag.recorder import main; sys.exit(main())"
        with open(tmp_path / "said.txt", "w") as said:
            process = subprocess.Popen(
                [sys.executable, "-c", code, "--out", str(tmp_path), "--name", "t", *arguments],
                env=environment,
                stdout=said,
                stderr=subprocess.STDOUT,
                text=True,
            )
        started.append(process)
        _wait_for(lambda: "recording" in _said(tmp_path), tmp_path)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.wait()


def _said(folder: Path) -> str:
    return (folder / "said.txt").read_text()


def _wait_for(condition: Callable[[], bool], folder: Path) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, _said(folder)
        time.sleep(0.05)


def _wait_until_received(folder: Path, publishers: Mapping[str, Any]) -> None:
    """Publish with stamp 0 until the recorder says that it receives every topic."""
    from hydro_msgs_docs.messages import joint_state

    def received() -> bool:
        for publisher in publishers.values():
            publisher.publish(joint_state(0, ["lift", "tilt"], position=[0.0, 0.0]))
        return all(f"receiving {topic}\n" in _said(folder) for topic in publishers)

    _wait_for(received, folder)


def _publishers(node: Any, topics: Sequence[str] = CYCLE_TOPICS) -> dict[str, Any]:
    from sensor_msgs.msg import JointState

    from hydro_msgs_docs.topics import reliable

    return {t: node.create_publisher(JointState, t, reliable(1000)) for t in topics}


def _publish(publishers: Mapping[str, Any], count: int, period_s: float = 0.002) -> float:
    """Publish so many cycles; by how much the latest was late, s: 0 where nothing else runs."""
    from hydro_msgs_docs.messages import joint_state

    begin, late_s = time.monotonic(), 0.0
    for k in range(count):
        message = joint_state(START_NS + 2_000_000 * k, ["lift", "tilt"], position=[k, -k])
        for publisher in publishers.values():
            publisher.publish(message)
        left_s = begin + (k + 1) * period_s - time.monotonic()
        late_s = max(late_s, -left_s)
        time.sleep(max(0.0, left_s))
    return late_s


def _wait_until_delivered(publishers: Mapping[str, Any]) -> None:
    from rclpy.duration import Duration

    for publisher in publishers.values():
        assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE_S))


def _only_bag(folder: Path) -> Path:
    (path,) = folder.glob("*_t")
    return path


@pytest.mark.ros
def test_everything_published_is_recorded(tmp_path, node, recorder) -> None:
    from sensor_msgs.msg import JointState

    from hydro_msgs_docs.messages import joint_state
    from hydro_msgs_docs.topics import latched

    base = node.create_publisher(JointState, "/base_parameters", latched())
    base.publish(joint_state(5, ["tilt_link.mcx"], effort=[1.5], velocity=[0.1]))
    (tmp_path / "map.yaml").write_text("a: 1\n")
    attach = f"mapping={tmp_path / 'map.yaml'}"
    told = tmp_path / "told.json"
    process = recorder("--note", "cold oil", "--attach", attach, "--json", str(told))
    publishers = _publishers(node)
    _wait_until_received(tmp_path, publishers)
    _publish(publishers, 1000)
    _wait_until_delivered(publishers)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
    assert "LOST" not in _said(tmp_path)
    bag = read_bag(_only_bag(tmp_path))
    assert bag.losses == ()
    assert bag.checksummed
    for topic in CYCLE_TOPICS:
        series = bag.series[topic]
        run = series.stamp_ns > 0
        np.testing.assert_array_equal(series.stamp_ns[run], START_NS + 2_000_000 * np.arange(1000))
        np.testing.assert_array_equal(series.fields["position"][run, 1], -np.arange(1000.0))
        assert (np.diff(series.log_ns) >= 0).all()
    assert bag.series["/base_parameters"].fields["effort"].tolist() == [[1.5]]
    data = json.loads(told.read_text())
    assert data["bag"] == str(_only_bag(tmp_path))
    held = {topic: info.count for topic, info in bag.topics.items()}
    assert {t: one["messages"] for t, one in data["topics"].items()} == held
    assert (data["messages"], data["lost"]) == (sum(held.values()), 0)
    assert data["bytes"] == sum(f.stat().st_size for f in _only_bag(tmp_path).iterdir())
    assert bag.metadata["robot"] == "xs031"
    assert bag.metadata["note"] == "cold oil"
    assert bag.metadata["mapping"] == "a: 1\n"
    assert bag.metadata["robot_file"].startswith("#") or "cylinders" in bag.metadata["robot_file"]
    text = (_only_bag(tmp_path) / "metadata.yaml").read_text()
    assert "transient_local" in text
    assert text.count("RIHS01_") == len(bag.topics)


@pytest.fixture
def running(node: Any) -> Iterator[Callable[..., None]]:
    """Starts nodes with parameters, which answer in the background."""
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    executor = SingleThreadedExecutor(context=node.context)
    nodes: list[Any] = []

    def start(name: str, parameters: Mapping[str, Any]) -> None:
        nodes.append(Node(name, context=node.context))
        nodes[-1].declare_parameters("", list(parameters.items()))
        executor.add_node(nodes[-1])

    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    yield start
    executor.shutdown()
    thread.join()
    for one in nodes:
        one.destroy_node()


@pytest.mark.ros
def test_what_runs_is_asked_for_its_parameters(tmp_path, node, running, recorder) -> None:
    """And for the mapping that it uses; while it is recorded, whatever is attached."""
    (tmp_path / "lab.mapping.yaml").write_text("schema: lab\n")
    running("controller", {"robot": "xs031", "kx": [40.0, 30.0]})
    running("can_bridge", {"mapping": str(tmp_path / "lab.mapping.yaml"), "max_age_ms": 10.0})
    gains = tmp_path / "gains.yaml"
    gains.write_text("mine: 1\n")
    for attached in ((), ("--attach", f"controller_parameters={gains}")):
        process = recorder(*attached)
        publishers = _publishers(node)
        _wait_until_received(tmp_path, publishers)
        _wait_for(lambda: b"max_age_ms" in _file_of(tmp_path).read_bytes(), tmp_path)
        if not attached:
            _wait_for(lambda: b"kx" in _file_of(tmp_path).read_bytes(), tmp_path)
        _publish(publishers, 100)
        _wait_until_delivered(publishers)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
        bag = read_bag(_only_bag(tmp_path))
        assert bag.losses == ()
        assert bag.metadata == _metadata_of(tmp_path)
        assert bag.metadata["mapping"] == "schema: lab\n"
        assert "max_age_ms: 10.0" in bag.metadata["bridge_parameters"]
        told = yaml.safe_load(bag.metadata["controller_parameters"])
        asked = told.get("controller", {}).get("ros__parameters", {})
        assert told == {"mine": 1} if attached else asked["kx"] == [40.0, 30.0]
        shutil.rmtree(_only_bag(tmp_path))


@pytest.mark.ros
def test_a_mapping_that_is_gone_is_said_and_it_is_recorded(tmp_path, running, recorder) -> None:
    running("can_bridge", {"mapping": str(tmp_path / "gone.yaml"), "robot": "xs031"})
    process = recorder()
    _wait_for(lambda: "gone.yaml: cannot be attached" in _said(tmp_path), tmp_path)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
    assert {"mapping", "controller_parameters"}.isdisjoint(_metadata_of(tmp_path))


@pytest.mark.ros
def test_a_node_that_is_being_configured_is_asked_again(tmp_path, node, recorder) -> None:
    """And said where it never answers; of a bridge that names no mapping it is the shipped one."""
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    bridge = Node("can_bridge", context=node.context)
    bridge.declare_parameters("", [("mapping", ""), ("robot", "xs031")])
    deaf = Node("controller", context=node.context)
    process = recorder()
    time.sleep(3.0)  # longer than it may take to answer
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(bridge)
    try:
        _wait_for(
            lambda: executor.spin_once(0.05) or b"bridge_param" in _file_of(tmp_path).read_bytes(),
            tmp_path,
        )
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
    finally:
        executor.shutdown()
        bridge.destroy_node()
        deaf.destroy_node()
    assert "schema:" in _metadata_of(tmp_path)["mapping"]
    silent = "/controller did not answer: the bag is without controller_parameters"
    assert _said(tmp_path).count(silent) == 1


def _file_of(folder: Path) -> Path:
    (file,) = _only_bag(folder).glob("*.mcap")
    return file


def _metadata_of(folder: Path) -> dict[str, str]:
    text = (_only_bag(folder) / "metadata.yaml").read_text()
    told: dict[str, str] = yaml.safe_load(text)["rosbag2_bagfile_information"]["custom_data"]
    return told


@pytest.mark.ros
def test_two_publishers_of_a_topic_are_no_loss(tmp_path, node, recorder) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    from hydro_msgs_docs.topics import DIAGNOSTICS, reliable

    first, second = (node.create_publisher(DiagnosticArray, DIAGNOSTICS, reliable()) for _ in "ab")
    for _ in range(40):  # nobody listens yet: the first is far ahead in its numbers
        first.publish(DiagnosticArray())
    process = recorder("--topics", DIAGNOSTICS)

    def received() -> bool:
        second.publish(DiagnosticArray())
        first.publish(DiagnosticArray())
        return f"receiving {DIAGNOSTICS}\n" in _said(tmp_path)

    _wait_for(received, tmp_path)
    for _ in range(20):
        received()
        time.sleep(0.01)
    _wait_until_delivered({"a": first, "b": second})
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
    assert read_bag(_only_bag(tmp_path)).topics[DIAGNOSTICS].count >= 40
    assert "LOST" not in _said(tmp_path)


@pytest.mark.ros
def test_two_publishers_of_one_topic_are_no_loss(tmp_path, node, recorder) -> None:
    """Each numbers its own messages: what one counts is nothing that the other lost."""
    process = recorder("--topics", CYCLE_TOPICS[0])
    first = _publishers(node, CYCLE_TOPICS[:1])
    _wait_until_received(tmp_path, first)
    _publish(first, 300)
    second = _publishers(node, CYCLE_TOPICS[:1])
    _wait_for(lambda: second[CYCLE_TOPICS[0]].get_subscription_count() > 0, tmp_path)
    for _ in range(100):
        _publish(second, 1)
        _publish(first, 1)
    _wait_until_delivered(first)
    _wait_until_delivered(second)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
    assert "LOST" not in _said(tmp_path)
    assert len(read_bag(_only_bag(tmp_path)).series[CYCLE_TOPICS[0]]) >= 500


@pytest.mark.ros
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["term", "hup"])
def test_signals_end_it_with_a_closed_bag(tmp_path, node, recorder, number) -> None:
    process = recorder()
    publishers = _publishers(node)
    _wait_until_received(tmp_path, publishers)
    _publish(publishers, 50)
    process.send_signal(number)
    assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
    assert read_bag(_only_bag(tmp_path)).losses == ()


@pytest.mark.ros
def test_that_nothing_comes_is_said_while_it_records_and_at_its_end(tmp_path, recorder) -> None:
    process = recorder()
    text = f"nothing was received: are the nodes up, and in this ROS domain ({DOMAIN})?"
    _wait_for(lambda: text in _said(tmp_path), tmp_path)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0, _said(tmp_path)
    first, during, count, at_end = _said(tmp_path).splitlines()
    assert first.startswith("recording ")
    assert count.startswith("recorded 0 messages")
    assert [during, at_end.strip()] == [text, text]


@pytest.mark.ros
def test_a_kill_costs_at_most_three_tenths_of_a_second(tmp_path, node, recorder) -> None:
    process = recorder()
    publishers = _publishers(node)
    _wait_until_received(tmp_path, publishers)
    waited = threads_waited_ns(process.pid)
    late_s = _publish(publishers, 700)
    waited_ms = longest_wait_ms(waited, threads_waited_ns(process.pid))
    process.kill()
    killed_ns = time.time_ns()
    process.wait()
    bag = read_bag(_only_bag(tmp_path))
    assert any("not closed" in loss for loss in bag.losses)
    # A machine that keeps this process waiting keeps the recorder waiting, too; or it alone.
    most_ns = 300_000_000 + round(3e9 * late_s + 1e6 * waited_ms)
    for topic in CYCLE_TOPICS:
        assert killed_ns - bag.topics[topic].last_log_ns <= most_ns, topic
        stamps = bag.series[topic].stamp_ns
        stamps = stamps[stamps > 0]
        np.testing.assert_array_equal(stamps, START_NS + 2_000_000 * np.arange(len(stamps)))


@pytest.mark.ros
def test_what_arrives_last_is_written_though_nothing_follows(tmp_path, node, recorder) -> None:
    process = recorder("--topics", "joint_states")
    publishers = {"/joint_states": _publishers(node)["/joint_states"]}
    _wait_until_received(tmp_path, publishers)
    _publish(publishers, 5)

    def written() -> int:
        """Messages in the file as it is at this moment, as if the recorder were killed now."""
        copy = shutil.copytree(_only_bag(tmp_path), tmp_path / f"copy{next(copies)}")
        try:
            series = read_bag(copy).series
        except BagError:
            return 0  # nothing yet
        return int((series["/joint_states"].stamp_ns > 0).sum())

    copies = itertools.count()
    _wait_for(lambda: written() == 5, tmp_path)
    process.kill()
    process.wait()
    assert (read_bag(_only_bag(tmp_path)).series["/joint_states"].stamp_ns > 0).sum() == 5
