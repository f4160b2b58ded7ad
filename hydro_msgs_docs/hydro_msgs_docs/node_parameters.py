"""ROS parameters of nodes, described once: declared, read and documented from the same rules.

No ROS at the head: rules are looked at without it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hydro_msgs_docs.errors import ContractError

Value = str | int | float | bool
_KINDS = {str: "string", int: "integer", float: "double", bool: "boolean"}


class ParameterError(ContractError):
    """A parameter of another type, out of its range or none of its choices."""


@dataclass(frozen=True, slots=True)
class ParameterRule:
    """One parameter.

    Attributes
    ----------
    name : str
    default : str, int, float or bool
        Its type is the parameter's.
    unit : str
        Empty for none.
    text : str
        What it means.
    lower, upper : float
        Range of a number, both included; NaN where there is none.
    choices : tuple of str
        Values of a text; empty for any.
    """

    name: str
    default: Value
    unit: str
    text: str
    lower: float = math.nan
    upper: float = math.nan
    choices: tuple[str, ...] = ()

    @property
    def meaning(self) -> str:
        """What it means, with its unit."""
        return f"{self.text}, {self.unit}" if self.unit else self.text

    @property
    def span(self) -> str:
        """What it may be, where not everything of its type."""
        if math.isnan(self.lower):
            return " / ".join(self.choices)
        return f"{self.lower:g} to {self.upper:g}"

    @property
    def expected(self) -> str:
        """What it should be, for the line of an error."""
        if isinstance(self.default, str):
            return "a text"
        if isinstance(self.default, bool):
            return "true or false"
        kind = "an integer" if isinstance(self.default, int) else "a number with a decimal point"
        return kind if math.isnan(self.lower) else f"{kind} from {self.lower:g} to {self.upper:g}"


def declare(node: Any, rules: Sequence[ParameterRule], *, read_only: bool = False) -> None:
    """Declare parameters on a node.

    Parameters
    ----------
    node : rclpy.node.Node
    rules : sequence of ParameterRule
    read_only : bool
        They are what they are given at start.

    Raises
    ------
    ParameterError
        A given value has the wrong type or lies outside its range; its cause is rclpy's own.
    """
    from rclpy.exceptions import (
        InvalidParameterTypeException,
        InvalidParameterValueException,
        ParameterUninitializedException,
    )

    for rule in rules:
        try:
            node.declare_parameter(rule.name, rule.default, _descriptor(rule, read_only))
        except (
            InvalidParameterTypeException,
            InvalidParameterValueException,
            ParameterUninitializedException,
        ) as error:
            found = _given(node, rule)
            value = "a wrong type" if found is None else repr(found)
            raise ParameterError(
                f"parameter {rule.name} should be {rule.expected}, found {value}"
            ) from error


def _descriptor(rule: ParameterRule, read_only: bool) -> Any:
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    made = ParameterDescriptor(name=rule.name, description=rule.meaning, read_only=read_only)
    if math.isnan(rule.lower):
        return made
    ends = rule.lower, rule.upper
    if isinstance(rule.default, int):
        steps = IntegerRange(from_value=int(ends[0]), to_value=int(ends[1]), step=1)
        made.integer_range = [steps]
    else:
        span = FloatingPointRange(from_value=float(ends[0]), to_value=float(ends[1]), step=0.0)
        made.floating_point_range = [span]
    return made


def _given(node: Any, rule: ParameterRule) -> object:
    """What a parameter that could not be declared was given, of whatever type."""
    from rcl_interfaces.msg import ParameterDescriptor

    of_any_type = ParameterDescriptor(dynamic_typing=True)
    value: object = node.declare_parameter(rule.name, rule.default, of_any_type).value
    node.undeclare_parameter(rule.name)
    return value


def values_of(node: Any, rules: Sequence[ParameterRule]) -> dict[str, Any]:
    """Parameters as they stand on a node.

    Parameters
    ----------
    node : rclpy.node.Node
    rules : sequence of ParameterRule
        Declared on it.

    Returns
    -------
    dict
        By name, of the types of their defaults.
    """
    return {rule.name: node.get_parameter(rule.name).value for rule in rules}


def check_choices(rules: Sequence[ParameterRule], values: Mapping[str, Any]) -> None:
    """Refuse texts that are none of their parameter's choices, which descriptors cannot tell.

    Parameters
    ----------
    rules : sequence of ParameterRule
    values : mapping
        By name, one for every rule.

    Raises
    ------
    ParameterError
    """
    for rule in rules:
        if rule.choices and values[rule.name] not in rule.choices:
            raise ParameterError(
                f"parameter '{rule.name}' should be one of {', '.join(rule.choices)},"
                f" found '{values[rule.name]}'"
            )


def table_of(rules: Sequence[ParameterRule]) -> str:
    """Parameters as a Markdown table, for the documentation.

    Parameters
    ----------
    rules : sequence of ParameterRule

    Returns
    -------
    str
    """
    lines = ["| parameter | type | default | range | unit | what |", "|---|---|---|---|---|---|"]
    for rule in rules:
        text = str(rule.default)
        text = text.lower() if isinstance(rule.default, bool) else text
        default = f"`{text}`" if text else "(empty)"
        kind = _KINDS[type(rule.default)]
        cells = (f"`{rule.name}`", kind, default, rule.span, rule.unit, rule.text)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
