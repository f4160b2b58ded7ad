"""A parameters file of the bridge: what ROS would pass over unsaid is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.node.parameter_file import check_parameter_file

GIVEN = ("robot", "can")


def written(folder: Path, text: str) -> Path:
    file = folder / "own.yaml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("node", ["can_bridge", "/can_bridge", "/**"])
@pytest.mark.parametrize("name", ["max_age_ms", "use_sim_time", "qos_overrides./joint_states.x"])
def test_what_the_bridge_takes_is_taken(tmp_path: Path, node: str, name: str) -> None:
    text = f"{node}:\n  ros__parameters:\n    {name}: 4\nelse: {{ros__parameters: {{a: 1}}}}\n"
    check_parameter_file(written(tmp_path, text), GIVEN)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bridge: {ros__parameters: {max_age_ms: 4.0}}", "'ros__parameters:', found bridge"),
        ("can_bridge: {ros__parameters: {}}", "'ros__parameters:', found can_bridge"),
        ("can_bridge: {max_age_ms: 4.0}", "key 'ros__parameters' is missing"),
        ("can_bridge: {ros__parameters: {max_age: 4.0}}", r"\(dbc, .*\), found 'max_age'"),
        ("can_bridge: {ros__parameters: {robot: emps}}", "'robot' by its option alone"),
        (
            "/**: {ros__parameters: {max_age_ms: 4.0}}\ncan_bridge: {ros__parameters: {can: c}}",
            "'can' by its option alone",
        ),
        ("max_age_ms 4.0", "expected a mapping of keys, found a text"),
    ],
)
def test_what_would_be_passed_over_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(BridgeError, match=said) as refused:
        check_parameter_file(file, GIVEN)
    assert str(refused.value).startswith(str(file))
