"""A parameters file of the controller: what ROS would pass over unsaid is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from hydro_control.errors import ControlError
from hydro_control.gains import shipped_gains
from hydro_control.node.parameter_file import check_parameter_file

ALL, OWN = "/**: {ros__parameters: {k_v: 1.0}}\n", "controller: {ros__parameters: {robot: emps}}\n"


def written(folder: Path, text: str) -> Path:
    file = folder / "own.yaml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("name", ["gains", "paper_table3"])
def test_what_is_shipped_is_taken(name: str) -> None:
    check_parameter_file(shipped_gains(name), ("robot", "path"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("controller: {ros__parameters: {kv: 3.0e4}}", r"\(robot, path, .*\), found 'kv'"),
        ("gains: {ros__parameters: {k_v: 3.0e4}}", "below 'controller:' and .* found gains"),
        (ALL + OWN, "'robot' by its option alone, or 'controller:' before '/[*][*]:'"),
        ("k_v 3.0e4", "expected a mapping of keys, found a text"),
    ],
)
def test_what_would_be_passed_over_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(ControlError, match=said) as refused:
        check_parameter_file(file, ("robot",))
    assert str(refused.value).startswith(str(file))


@pytest.mark.ros
@pytest.mark.parametrize("node", ["controller", "/controller", "/**", "**", "*", "/*"])
@pytest.mark.parametrize("before", [True, False])
def test_what_is_refused_is_what_ros_would_take_in_place_of_the_option(
    tmp_path: Path, node: str, before: bool
) -> None:
    import rclpy

    own = f"'{node}': {{ros__parameters: {{robot: emps}}}}\n"
    if node == "/**":
        file = written(tmp_path, own)
    else:
        file = written(tmp_path, ALL + own if before else own + ALL)
    context = rclpy.Context()
    words = ["controller", "--ros-args", "--params-file", str(file), "-p", "robot:=xs031"]
    rclpy.init(args=words, context=context)
    one = rclpy.create_node("controller", context=context, start_parameter_services=False)
    taken = one.declare_parameter("robot", "").value
    one.destroy_node()
    context.shutdown()
    try:
        check_parameter_file(file, ("robot",))
    except ControlError:
        assert taken == "emps"
    else:
        assert taken == "xs031"
    check_parameter_file(file, ())
