"""Rules of parameters: what a node declares, refuses and documents by them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest

from hydro_msgs_docs.node_parameters import (
    ParameterError,
    ParameterRule,
    check_choices,
    declare,
    table_of,
    values_of,
)

DOMAIN = 10 + (os.getpid() + 20) % 90
RULES = (
    ParameterRule("gain", 2.0, "1/s", "how fast", 0, 100),
    ParameterRule("bias", 0.5, "V", "as it is"),
    ParameterRule("count", 3, "", "how many", 1, 8),
    ParameterRule("locked", False, "", "whether"),
    ParameterRule("name", "", "", "what it is called"),
    ParameterRule("mode", "slow", "", "how", choices=("slow", "fast")),
)
Given = Callable[..., AbstractContextManager[Any]]


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> Given:
    """Makes a node whose command line gives parameters."""
    rclpy = pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

    @contextmanager
    def made(*parameters: str) -> Iterator[Any]:
        context = rclpy.Context()
        words = [word for text in parameters for word in ("-p", text)]
        rclpy.init(args=["one", "--ros-args", *words], context=context, domain_id=DOMAIN)
        node = rclpy.create_node("one", context=context, start_parameter_services=False)
        yield node
        node.destroy_node()
        rclpy.try_shutdown(context=context)

    return made


@pytest.mark.ros
@pytest.mark.parametrize("read_only", [True, False])
def test_what_is_given_is_read_and_the_rest_is_the_default(given: Given, read_only: bool) -> None:
    from rclpy.parameter import Parameter

    with given("gain:=7.0", "mode:=fast") as node:
        declare(node, RULES, read_only=read_only)
        defaults = {rule.name: rule.default for rule in RULES}
        assert values_of(node, RULES) == defaults | {"gain": 7.0, "mode": "fast"}
        (result,) = node.set_parameters([Parameter("gain", value=8.0)])
        assert result.successful is not read_only
        (result,) = node.set_parameters([Parameter("count", value=9)])
        assert not result.successful
        assert node.describe_parameter("gain").description == "how fast, 1/s"


@pytest.mark.ros
@pytest.mark.parametrize(
    ("parameter", "said"),
    [
        ("gain:=-1.0", "gain should be a number with a decimal point from 0 to 100, found -1.0"),
        ("gain:=.nan", "gain should be a number with a decimal point from 0 to 100, found nan"),
        ("gain:=1", "gain should be a number with a decimal point from 0 to 100, found 1"),
        ("bias:=low", "bias should be a number with a decimal point, found 'low'"),
        ("count:=9", "count should be an integer from 1 to 8, found 9"),
        ("locked:=2", "locked should be true or false, found 2"),
        ("name:=3", "name should be a text, found 3"),
    ],
)
def test_what_cannot_be_is_refused_with_what_was_given(
    given: Given, parameter: str, said: str
) -> None:
    with given(parameter) as node:
        with pytest.raises(ParameterError) as refused:
            declare(node, RULES)
        assert str(refused.value) == f"parameter {said}"
        assert not node.has_parameter(parameter.partition(":")[0])


def test_a_text_that_is_none_of_the_choices_is_refused() -> None:
    values = {rule.name: rule.default for rule in RULES}
    check_choices(RULES, values)
    with pytest.raises(ParameterError, match="'mode' should be one of slow, fast, found 'both'"):
        check_choices(RULES, values | {"mode": "both"})


def test_the_table_says_all_of_a_rule() -> None:
    head, line, *rows = table_of(RULES).splitlines()
    assert {row.count("|") for row in (head, line, *rows)} == {7}
    assert rows == [
        "| `gain` | double | `2.0` | 0 to 100 | 1/s | how fast |",
        "| `bias` | double | `0.5` |  | V | as it is |",
        "| `count` | integer | `3` | 1 to 8 |  | how many |",
        "| `locked` | boolean | `false` |  |  | whether |",
        "| `name` | string | (empty) |  |  | what it is called |",
        "| `mode` | string | `slow` | slow / fast |  | how |",
    ]
