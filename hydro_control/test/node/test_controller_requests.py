"""What is asked of the controller process: paths, parameters, transitions, adaptation."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_control.node import send_path
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot_files import load_robot
from hydro_msgs_docs import topics

pytestmark = pytest.mark.ros


def diagnosed(machine: Any, text: str) -> bool:
    """Whether the controller has said so."""
    return any(text in d.status[0].message for d in machine.heard[topics.DIAGNOSTICS])


def test_a_sent_path_is_played_and_a_far_one_refused(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    wait_for: Callable[..., bool],
    run_module: Callable[..., Any],
    patience_s: float,
) -> None:
    process = controller()
    for k in range(3):
        machine.answer(k)
    near, far = tmp_path / "near.yaml", tmp_path / "far.yaml"
    text = "joints: [tilt]\nstart: [{}]\nsegments: [{{kind: move, to: [{}], duration_s: 2.0}}]\n"
    near.write_text(text.format(-1.5, -1.4))
    far.write_text(text.format(-0.5, -0.6))
    assert run_module("send_path", str(far), "--timeout", "100").returncode == 0

    expected = "starts 1.000 rad or m from where the robot stands"
    assert wait_for(lambda: diagnosed(machine, expected))
    sent = run_module("send_path", str(near), "--timeout", "100", "--json", "-")
    assert sent.returncode == 0, sent.stderr
    told = json.loads(sent.stdout)
    assert (told["kind"], told["joints"], told["duration_s"]) == ("joint", ["tilt"], 2.0)
    assert (told["topic"], told["path"]) == (topics.JOINT_TRAJECTORY, str(near))
    assert (told["start"], told["end"]) == ([-1.5], pytest.approx([-1.4]))
    assert tilt_reaches(0.05, machine, 3, patience_s)
    assert process.poll() is None


def test_a_sent_stop_ends_what_is_played(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    run_module: Callable[..., Any],
    patience_s: float,
) -> None:
    process = controller()
    for k in range(3):
        machine.answer(k)
    path = tmp_path / "long.yaml"
    path.write_text(
        "joints: [tilt]\nstart: [-1.5]\nsegments: [{kind: move, to: [-1.2], duration_s: 6.0}]\n"
    )
    assert run_module("send_path", str(path), "--timeout", "100").returncode == 0
    assert tilt_reaches(0.05, machine, 3, patience_s)
    cycle = len(machine.heard[topics.JOINT_REFERENCE])
    sent = run_module("send_path", "--stop", "--timeout", "100", "--json", "-")
    assert sent.returncode == 0, sent.stderr
    told = json.loads(sent.stdout)
    assert (told["kind"], told["topic"], told["points"]) == ("stop", topics.JOINT_TRAJECTORY, 0)
    end, speeds = time.monotonic() + patience_s, [1.0]
    while speeds[-1] > 0.0 and time.monotonic() < end:
        machine.answer(cycle)
        cycle += 1
        speeds.append(abs(machine.heard[topics.JOINT_REFERENCE][-1].velocity[1]))
    assert speeds[-1] == 0.0
    # It slows down over up to half a second of samples, on its way: nothing is dropped at once.
    assert 50 < len(speeds) < 350
    assert -1.5 < machine.heard[topics.JOINT_REFERENCE][-1].position[1] < -1.25
    assert process.poll() is None


def _single_point(space: str, at_s: int) -> tuple[str, Any]:
    """A topic and a message of a single point, where the arm stands, at a time."""
    from builtin_interfaces.msg import Duration
    from geometry_msgs.msg import Transform, Vector3
    from trajectory_msgs.msg import (
        JointTrajectory,
        JointTrajectoryPoint,
        MultiDOFJointTrajectory,
        MultiDOFJointTrajectoryPoint,
    )

    at_time = {"time_from_start": Duration(sec=at_s)}
    if space == "joint":
        joints = JointTrajectoryPoint(positions=[0.6], **at_time)
        return topics.JOINT_TRAJECTORY, JointTrajectory(joint_names=["lift"], points=[joints])
    x, y, z = tip_position(load_robot("xs031"), np.array([0.6, -1.5])).tolist()
    at = Transform(translation=Vector3(x=x, y=y, z=z))
    tip = MultiDOFJointTrajectoryPoint(transforms=[at], **at_time)
    return topics.TIP_TRAJECTORY, MultiDOFJointTrajectory(joint_names=["tip_link"], points=[tip])


@pytest.mark.parametrize("space", ["joint", "tip"])
def test_a_single_point_before_time_0_is_refused_and_the_arm_held_on(
    space: str,
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    wait_for: Callable[..., bool],
) -> None:
    process = controller()
    machine.answer(0)
    topic, message = _single_point(space, -1)
    publisher = machine.publisher(topic, topics.reliable())
    assert wait_for(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(message)
    expected = "grow from 0 s, found -1 s at point 0"
    assert wait_for(lambda: diagnosed(machine, expected) or process.poll() is not None)
    assert process.poll() is None
    machine.answer(1)


def test_a_stop_is_heard_while_a_long_trajectory_is_checked(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    """Minutes of the tip take seconds to check; what was stopped meanwhile is not played."""
    from trajectory_msgs.msg import MultiDOFJointTrajectory

    process = controller()
    machine.answer(0)
    topic, message = _single_point("tip", 200)
    publisher = machine.publisher(topic, topics.reliable())
    assert wait_for(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(message)
    publisher.publish(MultiDOFJointTrajectory())
    assert wait_for(lambda: diagnosed(machine, "a stop was asked for while it was checked"))
    assert process.poll() is None
    machine.answer(1)
    assert not any(machine.heard[topics.JOINT_REFERENCE][-1].velocity)


@pytest.mark.parametrize(("arguments", "found"), [((), "neither"), (("a.yaml", "--stop"), "both")])
def test_a_path_or_a_stop_is_sent(
    run_module: Callable[..., Any], arguments: tuple[str, ...], found: str
) -> None:
    done = run_module("send_path", *arguments)
    assert done.returncode == 2
    assert done.stderr == f"send_path: expected a path file or --stop, found {found}\n"


@pytest.mark.parametrize("timeout", ["nan", "inf", "0", "-1", "soon"])
def test_a_time_to_wait_is_one(
    timeout: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A number that is none is never over, and so no wait for a controller would be."""
    monkeypatch.setattr(send_path, "_send", lambda *_: None)
    with pytest.raises(SystemExit, match="2"):
        send_path.run(["--stop", f"--timeout={timeout}"])
    assert "argument --timeout: " in capsys.readouterr().err
    assert send_path.run(["--stop", "--timeout=0.5"]) == 0


def tilt_reaches(speed: float, machine: Any, cycle: int, patience_s: float) -> bool:
    """Cycles are answered until the tilt's reference is so fast."""
    end, found = time.monotonic() + patience_s, 0.0
    while found < speed and time.monotonic() < end:
        machine.answer(cycle)
        cycle += 1
        if machine.heard[topics.JOINT_REFERENCE]:
            found = machine.heard[topics.JOINT_REFERENCE][-1].velocity[1]
    return found >= speed


def test_its_own_path_is_checked_from_the_pose_of_the_machine_and_played(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    patience_s: float,
) -> None:
    path = tmp_path / "path.yaml"
    path.write_text(
        "joints: [tilt]\nstart: [-1.5]\nsegments: [{kind: move, to: [-1.4], duration_s: 2.0}]\n"
    )
    process = controller(f"path:={path}", "start_delay_s:=0.0")
    assert tilt_reaches(0.05, machine, 0, patience_s)
    assert process.poll() is None


def test_a_listener_that_is_no_controller_is_none_to_send_a_path_to(
    machine: Any, tmp_path: Path, run_module: Callable[..., Any], wait_for: Callable[..., bool]
) -> None:
    """Such as a recorder without a controller: nobody plays what it takes."""
    path = tmp_path / "path.yaml"
    path.write_text(
        "joints: [tilt]\nstart: [-1.5]\nsegments: [{kind: move, to: [-1.4], duration_s: 2.0}]\n"
    )
    machine.listen(topics.JOINT_TRAJECTORY)
    sent = run_module("send_path", str(path), "--timeout", "5")
    assert sent.returncode == 1
    domain = machine.context.get_domain_id()
    assert sent.stderr == (
        "send_path: no controller listens on /joint_trajectory within 5 s in ROS domain"
        f" {domain}\n"
    )
    assert not wait_for(lambda: bool(machine.heard[topics.JOINT_TRAJECTORY]), 0.5)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["-p", "robot:=nowhere.yaml"], "no robot file 'nowhere.yaml'"),
        (["-p", "path:=nowhere.yaml"], "no path file 'nowhere.yaml'"),
        (["-p", "k_v:=-1.0"], "k_v should be a number with a decimal point from 0"),
        (["-p", "robot:=3"], "robot should be a text"),
        (["--params-file", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    arguments: list[str],
    expected: str,
    within: Callable[..., Any],
    run_module: Callable[..., Any],
) -> None:
    """One of them as a process of its own, too."""
    ended = [within(*arguments)]
    if "--params-file" in arguments:
        ended.append(run_module("node", "--ros-args", *arguments))
    for done in ended:
        assert done.returncode == 2
        assert expected in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1


def test_lifecycle_command_says_what_is_open(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    run_module: Callable[..., Any],
    patience_s: float,
) -> None:
    controller(activate=False)
    patient = ("--timeout", str(patience_s))
    refused = run_module("lifecycle_command", "activate", "controller", *patient)
    assert refused.returncode == 1
    assert "controller is unconfigured and cannot activate" in refused.stderr
    assert (
        run_module("lifecycle_command", "get", "controller", *patient).stdout == "unconfigured\n"
    )
    for asked in ("configure", "get"):
        done = run_module("lifecycle_command", asked, "controller", *patient, "--json", "-")
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        assert (told["node"], told["asked"], told["state"]) == ("/controller", asked, "inactive")
    absent = run_module("lifecycle_command", "get", "nobody", "--timeout", "0.2")
    assert absent.returncode == 1
    domain = machine.context.get_domain_id()
    expected = f"no node answers at /nobody/get_state within 0.2 s in ROS domain {domain}"
    assert expected in absent.stderr
    other = run_module("lifecycle_command", "clear_trip", "controller", "--timeout", "5")
    assert other.returncode == 1
    assert "/controller is there, and offers no clear_trip within 5 s" in other.stderr
    assert run_module("lifecycle_command", "fly", "controller").returncode == 2


def test_a_transition_that_is_not_open_is_refused_and_the_controller_goes_on(
    machine: Any, controller: Callable[..., subprocess.Popen[str]]
) -> None:
    """By its number alone, as managers of other nodes ask for it, perhaps twice."""
    process = controller()
    machine.answer(0)
    for name in ("activate", "configure", "cleanup"):
        assert not machine.tried(name)
    machine.answer(1)
    machine.transition("deactivate")
    assert not machine.tried("deactivate")
    machine.transition("activate")
    machine.answer(2)
    assert process.poll() is None


def test_lifecycle_command_clears_a_trip(
    machine: Any, run_module: Callable[..., Any], patience_s: float
) -> None:
    from std_srvs.srv import Trigger

    said = [(False, "still there: the emergency stop is pressed"), (True, "cleared: too old")]

    def answer(_request: Any, response: Any) -> Any:
        response.success, response.message = said.pop(0)
        return response

    machine.make(lambda: machine.node.create_service(Trigger, "/some_bridge/clear_trip", answer))
    words = ("lifecycle_command", "clear_trip", "some_bridge", "--timeout", str(patience_s))
    refused, cleared = run_module(*words), run_module(*words)
    assert refused.returncode == 1
    assert "/some_bridge is not cleared: still there: the emergency stop" in refused.stderr
    assert cleared.returncode == 0
    assert cleared.stdout == "cleared: too old\n"


def test_adaptation_is_told_and_reset(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    wait_for: Callable[..., bool],
    patience_s: float,
) -> None:
    from std_srvs.srv import Trigger

    service = "/controller/reset_adaptation"
    client = machine.make(lambda: machine.node.create_client(Trigger, service))
    controller("adaptation:=payload null_bias")
    for k in range(20):
        machine.answer(k)

    def told() -> dict[str, str]:
        statuses = [s for m in machine.heard[topics.DIAGNOSTICS] for s in m.status]
        return {v.key: v.value for s in statuses[-1:] for v in s.values}

    assert wait_for(lambda: told().get("adaptation") == "payload null_bias")
    assert told()["adaptation_frozen"] == "yes"
    assert float(told()["adapted/payload_kg"]) == 0.0
    assert client.wait_for_service(patience_s)
    future = client.call_async(Trigger.Request())
    assert wait_for(future.done)
    assert future.result().success


def test_adaptation_of_an_unknown_kind_ends_the_node_with_one_line(
    within: Callable[..., Any],
) -> None:
    done = within("-p", "adaptation:=mass")
    assert done.returncode == 2
    assert "expected some of payload, friction, null_bias" in done.stderr
    assert "Traceback" not in done.stderr
