"""Bad input to the executables: one clear line, exit 2, nothing overwritten, no traceback."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from importlib.metadata import distribution
from pathlib import Path

import pytest

from hydro_control.node import parameters as controller_parameters
from hydro_hw_bridge.node import parameters as bridge_parameters
from hydro_model.robot_files import shipped_robots

ROOT = Path(__file__).parents[1]
REFERENCE = shipped_robots()["xs031"].parent
DOMAIN = 10 + (os.getpid() + 22) % 90
BUS = "udp_multicast:239.74.163.2:43161"
Run = Callable[..., subprocess.CompletedProcess[str]]


def run(package: str, executable: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    path = ROOT / "ros2_ws/install" / package / "lib" / package / executable
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}
    return subprocess.run(
        [str(path), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=240,
        env=environment,
        check=False,
    )


@pytest.fixture
def within(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """As `run`, what an executable of Python calls in this process: once more of its kind."""

    def ended(
        package: str, executable: str, *arguments: object
    ) -> subprocess.CompletedProcess[str]:
        entries = distribution(package).entry_points
        (entry,) = entries.select(group="console_scripts", name=executable)
        words = [executable, *map(str, arguments)]
        monkeypatch.setattr("sys.argv", words)
        return subprocess.CompletedProcess(words, entry.load()(), *capfd.readouterr())

    return ended


def assert_refused(result: subprocess.CompletedProcess[str], *words: str) -> None:
    assert result.returncode == 2, result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    for word in words:
        assert word in lines[0]


@pytest.fixture
def robot_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "robot"
    shutil.copytree(REFERENCE, folder)
    return folder


def edited(folder: Path, old: str, new: str) -> Path:
    file = folder / "xs031.hydraulics.yaml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    return file


def users_of_robots(
    robot: object, tmp_path: Path, command: Run
) -> list[subprocess.CompletedProcess[str]]:
    """Every command that takes a robot, each given the same one; nodes as processes."""
    bag = tmp_path / "no_bag"
    return [
        command("hydro_ident", "identify", bag, "--robot", robot, "--out", tmp_path / "out"),
        command("hydro_ident", "excite", "--robot", robot, "--out", tmp_path / "out"),
        command("hydro_hw_bridge", "sim_rig", "--robot", robot, "--can", BUS),
        run("hydro_hw_bridge", "can_bridge", "--ros-args", "-p", f"robot:={robot}"),
        run("hydro_control", "controller", "--ros-args", "-p", f"robot:={robot}"),
    ]


@pytest.mark.ros
def test_missing_robot_file(tmp_path: Path) -> None:
    for result in users_of_robots(tmp_path / "nobody.yaml", tmp_path, run):
        assert_refused(result, "nobody.yaml", "xs031")
    assert not (tmp_path / "out").exists()


@pytest.mark.ros
def test_malformed_robot_file(robot_folder: Path, tmp_path: Path, within: Run) -> None:
    robot = edited(robot_folder, "bore_m: 0.080", "bore_m: eighty")
    for result in users_of_robots(robot, tmp_path, within):
        assert_refused(result, "xs031.hydraulics.yaml", "bore_m", "a number", "eighty")


def test_unknown_joint_name(robot_folder: Path, tmp_path: Path, within: Run) -> None:
    robot = edited(robot_folder, "joint: tilt", "joint: wrist")
    result = within("hydro_ident", "excite", "--robot", robot, "--out", tmp_path / "out")
    assert_refused(result, "wrist", "lift, tilt")


def test_valve_on_a_cylinder_that_is_not_there(
    robot_folder: Path, tmp_path: Path, within: Run
) -> None:
    robot = edited(robot_folder, "cylinder: tilt_cylinder, rated", "cylinder: bucket, rated")
    result = within("hydro_ident", "excite", "--robot", robot, "--out", tmp_path / "out")
    assert_refused(result, "bucket", "lift_cylinder, tilt_cylinder")


def test_mapping_with_a_valve_that_is_not_there(tmp_path: Path, within: Run) -> None:
    shipped = ROOT / "hydro_msgs_docs/can"
    shutil.copy(shipped / "xs031.dbc", tmp_path)
    mapping = tmp_path / "xs031.mapping.yaml"
    text = (shipped / "xs031.mapping.yaml").read_text()
    assert "tilt_valve" in text
    mapping.write_text(text.replace("tilt_valve", "bucket_valve"))
    result = within("hydro_hw_bridge", "sim_rig", "--can", BUS, "--mapping", mapping)
    assert_refused(result, "bucket_valve", "tilt_valve")


def test_absent_can_interface() -> None:
    assert_refused(run("hydro_hw_bridge", "sim_rig", "--can", "hydrocan7"), "hydrocan7")


#: Nodes that start ROS, with what else each has to be given.
NODES = (
    ("hydro_hw_bridge", "can_bridge", ()),
    ("hydro_control", "controller", ()),
    ("hydro_ident", "recorder", ("--out", "bags")),
    ("hydro_ident", "identification_node", ()),
    ("hydro_msgs_docs", "visual_joints", ()),
)


@pytest.mark.ros
@pytest.mark.parametrize(("package", "executable", "words"), NODES)
def test_arguments_that_ros_refuses(
    package: str,
    executable: str,
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    within: Run,
) -> None:
    monkeypatch.chdir(tmp_path)
    wrong = ("--ros-args", "--params-file", "nope.yaml")
    assert_refused(within(package, executable, *words, *wrong), "nope.yaml")
    # rcl says a line of its own before ours.
    result = within(package, executable, *words, "--ros-args", "-r", "__node:=two words")
    line = result.stderr.strip().splitlines()[-1]
    assert result.returncode == 2
    assert line.startswith(f"{executable}: ROS cannot be started as it was asked to")
    assert "two words" in line
    assert "Traceback" not in result.stderr
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.ros
def test_names_that_no_node_can_have(within: Run) -> None:
    for name in ("two words", ""):
        result = within("hydro_control", "lifecycle", "get", name)
        assert_refused(result, "expected a node's name", f"'{name}'")


@pytest.mark.ros
def test_a_domain_that_is_no_number(monkeypatch: pytest.MonkeyPatch, within: Run) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "lab")
    result = within("hydro_control", "lifecycle", "get", "controller")
    assert_refused(result, "ROS cannot be started", "ROS_DOMAIN_ID")


@pytest.mark.ros
def test_bridge_on_an_absent_can_interface() -> None:
    result = run("hydro_hw_bridge", "can_bridge", "--ros-args", "-p", "can:=hydrocan7")
    assert_refused(result, "hydrocan7")


@pytest.mark.parametrize("command", ["inspect", "tracking", "player"])
def test_no_bag_there(command: str, tmp_path: Path) -> None:
    assert_refused(run("hydro_ident", command, tmp_path / "nothing"), "nothing")


@pytest.mark.parametrize("command", ["inspect", "tracking", "player", "identify"])
def test_directory_that_is_no_bag(command: str, tmp_path: Path, within: Run) -> None:
    (tmp_path / "holiday").mkdir()
    (tmp_path / "holiday" / "photo.txt").write_text("sea")
    more = ["--robot", "xs031", "--out", tmp_path / "out"] if command == "identify" else []
    assert_refused(within("hydro_ident", command, tmp_path / "holiday", *more), "holiday")
    assert not (tmp_path / "out").exists()


def test_results_of_before_stay(tmp_path: Path, within: Run) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "result.json").write_text("{}")
    arguments = (tmp_path / "nothing", "--robot", "xs031", "--out", out)
    result = within("hydro_ident", "identify", *arguments)
    assert_refused(result, "nothing")
    assert (out / "result.json").read_text() == "{}"
    assert [p.name for p in out.iterdir()] == ["result.json"]


NODES = {
    "can_bridge": "hydro_hw_bridge",
    "controller": "hydro_control",
    "identification_node": "hydro_ident",
    "visual_joints": "hydro_msgs_docs",
}


@pytest.mark.parametrize("node", NODES)
def test_a_node_refuses_what_neither_it_nor_ros_takes(node: str) -> None:
    for arguments in (["--bogus"], ["--bogus", "--ros-args", "-p", "robot:=xs031"]):
        result = run(NODES[node], node, *arguments)
        assert result.returncode == 2, result.stderr
        assert "--bogus" in result.stderr.splitlines()[-1]
        assert "Traceback" not in result.stderr


@pytest.mark.parametrize("node", NODES)
def test_a_nodes_help_lists_its_parameters_with_their_defaults(node: str) -> None:
    result = run(NODES[node], node, "--help")
    assert (result.returncode, result.stderr) == (0, "")
    given = {
        "can_bridge": {p.name: p.default for p in bridge_parameters.PARAMETERS},
        "controller": {p.name: p.default for p in controller_parameters.PARAMETERS},
        "identification_node": dict.fromkeys(("bags", "robot"), "required"),
        "visual_joints": {"robot": "required", "rate_hz": 50.0},
    }[node]
    told = dict(re.findall(r"^  (\w+)  .*\[(.*)\]$", result.stdout, re.M))
    assert told == {name: str(default) for name, default in given.items()}


@pytest.mark.parametrize(
    ("script", "arguments", "word"),
    [
        ("bringup.sh", [], "--can"),
        ("bringup.sh", ["--sim", "--can", "can0"], "exclude"),
        ("bringup.sh", ["--robot"], "needs a value"),
        ("bringup.sh", ["--sim", "--controller", "none/gains.yaml"], "found none at 'none/gains"),
        (
            "bringup.sh",
            ["--sim", "--bridge", "none/b.yaml"],
            "--bridge: expected a file, found",
        ),
        ("bringup.sh", ["--can", "can0", "--drive"], "--calibration FILE"),
        ("bringup.sh", ["--can", "can0", "--drive"], "--no-calibration drives without"),
        ("bringup.sh", ["--sim", "--calibration", "c.yaml", "--no-calibration"], "exclude"),
        ("record.sh", [], "NAME"),
        ("replay.sh", ["no/such/bag"], "no/such/bag"),
        ("identify.sh", ["--robot", "xs031"], "BAG"),
        ("demo.sh", ["--fast"], "--fast"),
        ("rig_run.sh", ["--name", "x"], "--path"),
    ],
)
def test_scripts_refuse(script: str, arguments: list[str], word: str) -> None:
    result = subprocess.run(
        ["bash", str(ROOT / "scripts" / script), *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )
    assert_refused(result, word)


@pytest.mark.ros
@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--can", "hydrocan7"], "hydrocan7"),
        (["--can", "hydrocan7", "--drive", "--no-calibration"], "hydrocan7"),
        (["--sim", "--robot", "nobody.yaml"], "nobody.yaml"),
        (["--sim", "--bus", "udp_multicast:239.74.163.2:43162", "--path", "no.yaml"], "no.yaml"),
    ],
)
def test_bringup_says_why_it_cannot(arguments: list[str], word: str, tmp_path: Path) -> None:
    result = subprocess.run(
        ["bash", str(ROOT / "scripts/bringup.sh"), *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
        cwd=tmp_path,
        env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)},
    )
    assert_refused(result, word)


@pytest.mark.ros
def test_bringup_simulates_the_robot_that_it_is_given(tmp_path: Path) -> None:
    """No mapping is shipped for a robot of that name, which the rig is the first to say."""
    source = shipped_robots()["xs031"]
    shutil.copy(source.parent / "xs031.urdf", tmp_path)
    text = source.read_text(encoding="utf-8")
    assert "robot: xs031" in text
    own = tmp_path / "mycrane.hydraulics.yaml"
    own.write_text(text.replace("robot: xs031", "robot: mycrane"), encoding="utf-8")
    bus = ["--sim", "--bus", "udp_multicast:239.74.163.2:43164"]
    result = subprocess.run(
        ["bash", str(ROOT / "scripts/bringup.sh"), *bus, "--robot", own.name],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
        cwd=tmp_path,
        env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)},
    )
    assert_refused(result, "sim_rig: no mapping is shipped for robot 'mycrane'")


@pytest.mark.ros
@pytest.mark.parametrize(
    ("parameter", "said"),
    [
        ("max_age_ms: 3.0", "'max_age_ms': expected at least 4 ms"),  # the bridge itself
        ("max_age: 12.0", "expected parameters of can_bridge (required_subscribers, slew"),
        ("calibration: of_june.yaml", "expected 'calibration' by its option alone"),
    ],
)
def test_bringup_gives_the_bridge_its_file(parameter: str, said: str, tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(f"can_bridge:\n  ros__parameters:\n    {parameter}\n", encoding="utf-8")
    bus = ["--sim", "--bus", "udp_multicast:239.74.163.2:43163"]
    result = subprocess.run(
        ["bash", str(ROOT / "scripts/bringup.sh"), *bus, "--bridge", "own.yaml"],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
        cwd=tmp_path,
        env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)},
    )
    assert_refused(result, said)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            "controller: {ros__parameters: {kv: 3.0e4}}",
            "expected parameters of controller (robot,",
        ),
        (
            "/**: {ros__parameters: {k_v: 3.0e4}}\ncontroller: {ros__parameters: {robot: emps}}",
            "expected 'robot' by its option alone",
        ),
    ],
)
def test_bringup_looks_over_the_controllers_file(content: str, said: str, tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(content, encoding="utf-8")
    result = subprocess.run(
        ["bash", str(ROOT / "scripts/bringup.sh"), "--sim", "--controller", str(own)],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )
    assert_refused(result, said)


@pytest.mark.parametrize(
    "script", ["bringup", "record", "replay", "identify", "demo", "rig_run", "setup", "test"]
)
def test_scripts_explain_themselves(script: str) -> None:
    result = subprocess.run(
        ["bash", str(ROOT / "scripts" / f"{script}.sh"), "--help"],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )
    assert result.returncode == 0
    assert len(result.stdout.splitlines()) >= 2
    assert not result.stdout.startswith("#")
