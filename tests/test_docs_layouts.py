"""Layouts of live tools name topics, entries and fields that exist, and are up to date."""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from hydro_ident.report.palette import JOINTS
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots
from hydro_msgs_docs import live_layouts, topics
from hydro_msgs_docs.layouts_command import main

LAYOUTS = Path(__file__).resolve().parents[1] / "hydro_msgs_docs/layouts"
VIEWS = ("bringup", "tracking", "diagnosis")
JOINT_STATE = "sensor_msgs/msg/JointState"


def entry_names(robot: Robot, topic: str) -> tuple[str, ...]:
    """Names in a JointState topic, in order."""
    if topic == topics.CHAMBER_PRESSURES:
        return robot.pressure_names
    if topic in (topics.VALVE_COMMAND, topics.VALVE_STATE):
        return robot.valve_names
    return robot.joint_names


def field_type(kind: str, fields: list[str]) -> str:
    """Type of a field of a message, by its path; fails where there is none."""
    for field in fields:
        package, *_, name = kind.split("/")
        known = getattr(importlib.import_module(f"{package}.msg"), name)
        types: dict[str, str] = known.get_fields_and_field_types()
        assert field in types, f"{kind} has no field '{field}'"
        kind = types[field]
    return kind


def topic_of(series: str, end: str) -> str:
    found = [name for name in topics.MESSAGE_TYPES if series.startswith(name + end)]
    assert len(found) == 1, f"'{series}' is of no topic of the contract"
    return found[0]


def check_plotjuggler(robot: Robot, text: str) -> set[str]:
    """Topics of a layout whose every series exists."""
    root = ElementTree.fromstring(text)
    used = set()
    for curve in root.iter("curve"):
        series = curve.attrib["name"]
        topic = topic_of(series, "/")
        rest = series[len(topic) + 1 :]
        kind = topics.MESSAGE_TYPES[topic]
        if kind == JOINT_STATE:
            name, _, field = rest.rpartition("/")
            assert name in entry_names(robot, topic), series
            assert field_type(kind, [field]) == "sequence<double>"
        else:
            assert field_type(kind, rest.split("/")) == "double"
        used.add(topic)
    [chosen] = [e.attrib["value"] for e in root.iter("selected_topics")]
    assert used <= set(chosen.split(";")) <= set(topics.MESSAGE_TYPES)
    for splitter in root.iter("DockSplitter"):
        assert int(splitter.attrib["count"]) == len(splitter)
    return used


def panels(layout: Any) -> Iterator[str]:
    """Panels in a tree of pairs."""
    if isinstance(layout, str):
        yield layout
    else:
        yield from panels(layout["first"])
        yield from panels(layout["second"])


def check_foxglove(robot: Robot, text: str) -> set[str]:
    """Topics of a layout whose every path exists."""
    data = json.loads(text)
    assert sorted(panels(data["layout"])) == sorted(data["configById"])
    used = set()
    for panel in data["configById"].values():
        if "topicToRender" in panel:
            assert panel["topicToRender"] == topics.DIAGNOSTICS
        for path in panel.get("paths", []):
            topic = topic_of(path["value"], ".")
            kind = topics.MESSAGE_TYPES[topic]
            rest = path["value"][len(topic) + 1 :]
            if kind == JOINT_STATE:
                field, index = re.fullmatch(r"(\w+)\[(\d+)\]", rest).groups()  # type: ignore[union-attr]
                assert field_type(kind, [field]) == "sequence<double>"
                assert path["label"].split(" ")[0] == entry_names(robot, topic)[int(index)]
            else:
                assert field_type(kind, rest.split(".")) == "double"
            used.add(topic)
    return used


@pytest.mark.parametrize("view", VIEWS)
def test_every_series_of_the_layouts_exists(view: str) -> None:
    robot = load_robot("xs031")
    drawn = check_plotjuggler(robot, (LAYOUTS / f"plotjuggler/{view}.xml").read_text("utf-8"))
    assert drawn == check_foxglove(robot, (LAYOUTS / f"foxglove/{view}.json").read_text("utf-8"))
    assert topics.JOINT_STATES in drawn


def drawn_colours(view: str, folder: Path) -> dict[str, set[str]]:
    """Label of a signal to the colours that it has in either program's layout of a view."""
    found: dict[str, set[str]] = {}
    root = ElementTree.parse(folder / f"plotjuggler/{view}.xml")
    for curve in root.iter("curve"):
        name = re.sub(r"^/\w+/|/\w+$", "", curve.attrib["name"])
        found.setdefault(name, set()).add(curve.attrib["color"])
    data = json.loads((folder / f"foxglove/{view}.json").read_text("utf-8"))
    for panel in data["configById"].values():
        for path in panel.get("paths", []):
            found.setdefault(path["label"].split(" ")[0], set()).add(path["color"])
    return found


def test_a_joint_has_one_colour_as_in_the_reports(tmp_path: Path) -> None:
    robot = load_robot("xs031")
    assert live_layouts.COLOURS == JOINTS
    assert main(["--robot", "xs031", "--out", str(tmp_path)]) == 0
    seen = set()
    for view in VIEWS:
        for name, colours in drawn_colours(view, tmp_path).items():
            of = {"lift": {JOINTS[0], "#7FB8D8"}, "tilt": {JOINTS[1], "#EAAE7F"}}
            joint = next((j for j in robot.joint_names if name.startswith(j)), "")
            if joint:
                assert colours <= of[joint], (view, name)
                seen.add(name)
            else:
                assert not colours & (of["lift"] | of["tilt"]), (view, name)
    chambers = {f"{c.name}/{side}" for c in robot.cylinders for side in "ab"}
    assert seen >= {*robot.joint_names, *robot.valve_names, *chambers}


#: How eyes without red, green or blue cones see linear RGB (G. Machado, M. Oliveira and L.
#: Fernandes, IEEE Transactions on Visualization and Computer Graphics 15(6), 2009; severity 1).
EYES = np.array(
    [
        np.eye(3),
        [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
        [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]],
        [[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]],
    ]
)
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def seen(colour: str) -> np.ndarray:
    """CIE L*a*b* of a colour as each kind of eye sees it, (4, 3)."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    rgb = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = np.clip(EYES @ rgb, 0.0, 1.0) @ TO_XYZ.T / TO_XYZ.sum(axis=1)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    x, y, z = f.T
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], axis=1)


def apart(one: str, other: str) -> float:
    """Least difference of two colours to any kind of eye."""
    return float(np.linalg.norm(seen(one) - seen(other), axis=1).min())


def test_rails_and_tip_have_colours_of_their_own_on_every_robot() -> None:
    others = live_layouts.OTHERS
    least = min(apart(a, b) for a, b in combinations(JOINTS, 2))
    assert min(apart(a, b) for a in others for b in JOINTS) > least
    assert min(apart(a, b) for a, b in combinations(others, 2)) > least
    for name in sorted(shipped_robots()):
        robot = load_robot(name)
        signals = [s for view in live_layouts.views(robot) for s in view.signals]
        rails = {s.name: s.colour for s in signals if s.name in ("supply", "tank")}
        if robot.cylinders:
            assert rails == {"supply": others[0], "tank": others[1]}
        own = {s.name for s in signals if s.colour in others}
        assert own <= {"supply", "tank", ""}  # oil and tip are no entries of a JointState


def test_two_signals_of_a_plot_never_look_alike(tmp_path: Path) -> None:
    for name in sorted(shipped_robots()):
        for view in live_layouts.views(load_robot(name)):
            for plot in (plot for row in view.shown for plot in row):
                if len(plot.signals) <= len(JOINTS):
                    assert len({s.colour for s in plot.signals}) == len(plot.signals), plot.title


def test_all_topics_of_a_cycle_are_drawn_somewhere() -> None:
    robot = load_robot("xs031")
    drawn = [
        check_foxglove(robot, (LAYOUTS / f"foxglove/{view}.json").read_text("utf-8"))
        for view in VIEWS
    ]
    assert set(topics.CYCLE_TOPICS) <= set().union(*drawn)


def test_the_layouts_are_those_that_the_command_writes(tmp_path: Path) -> None:
    listed = tmp_path / "listed.json"
    assert main(["--robot", "xs031", "--out", str(tmp_path), "--json", str(listed)]) == 0
    files = sorted(str(file) for file in tmp_path.glob("*/*"))
    assert sorted(json.loads(listed.read_text())["files"]) == files
    written = {p.relative_to(tmp_path): p.read_bytes() for p in tmp_path.glob("*/*")}
    folders = ("foxglove", "plotjuggler")
    kept = {
        p.relative_to(LAYOUTS): p.read_bytes() for f in folders for p in LAYOUTS.glob(f"{f}/*")
    }
    assert written == kept, (
        "run: ros2 run hydro_msgs_docs live_layouts --robot xs031 --out hydro_msgs_docs/layouts"
    )


@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_every_robot_has_layouts(name: str, tmp_path: Path) -> None:
    assert main(["--robot", name, "--out", str(tmp_path)]) == 0
    for view in VIEWS:
        check_plotjuggler(load_robot(name), (tmp_path / f"plotjuggler/{view}.xml").read_text())
        check_foxglove(load_robot(name), (tmp_path / f"foxglove/{view}.json").read_text())


def test_a_folder_that_cannot_be_made_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["--robot", "xs031", "--out", str(tmp_path / "file")]) == 2
    assert "cannot be written" in capsys.readouterr().err
