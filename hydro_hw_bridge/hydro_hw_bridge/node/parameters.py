"""The parameters of `can_bridge`, described once: declared from here, documented from here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hydro_hw_bridge.bus.bus_name import DEFAULT_BUS
from hydro_hw_bridge.errors import BridgeError
from hydro_msgs_docs.real_time import OPTIONS, RealTimeOptions
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_STATE

REAL_TIME, LOCKSTEP = "real_time", "lockstep"
#: Of `CYCLE_TOPICS` those that the bridge publishes.
PUBLISHED_CYCLE_TOPICS = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_STATE)


@dataclass(frozen=True, slots=True)
class ParameterRule:
    """One parameter.

    Attributes
    ----------
    name, text : str
    default : str, float, int or bool
        Its type is the parameter's.
    low, high : float or None
        Range of a number.
    choices : tuple of str
        Values of a text; empty for any.
    """

    name: str
    text: str
    default: str | float | int | bool
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()


PARAMETERS = (
    ParameterRule("robot", "Robot file, or name of a shipped robot.", "xs031"),
    ParameterRule("can", "CAN bus as interface:channel[:port].", DEFAULT_BUS),
    ParameterRule("dbc", "DBC file; empty: the one that the mapping names.", ""),
    ParameterRule("mapping", "Mapping file; empty: the one shipped for the robot.", ""),
    ParameterRule("calibration", "Calibration file; empty: the mapping's own values.", ""),
    ParameterRule(
        "clock",
        "real_time: the device runs by itself; lockstep: each cycle waits for its answer.",
        REAL_TIME,
        choices=(REAL_TIME, LOCKSTEP),
    ),
    ParameterRule(
        "required_subscribers",
        "Subscribers to wait for before driving, as 'topic:count ...', such as"
        " '/joint_states:2 /chamber_pressures:2 /valve_state:2'; empty: none.",
        "",
    ),
    ParameterRule(
        "slew_limit_v_s",
        "Legal slew rate of a valve voltage, V/s; the gate trips above twice that.",
        1000.0,
        1.0,
        100000.0,
    ),
    ParameterRule(
        "reenable_slew_v_s",
        "Slew rate of the output in the first second of driving after a trip was cleared, V/s.",
        10.0,
        1.0,
        100000.0,
    ),
    ParameterRule(
        "max_age_ms", "Age of a command at which the gate trips, device time, ms.", 10.0, 2.0, 50.0
    ),
    ParameterRule(
        "min_supply_pa",
        "Supply pressure below which the gate trips, Pa gauge; 0: not checked.",
        2.0e6,
        0.0,
        40.0e6,
    ),
    ParameterRule(
        "slow_rate_hz",
        "Rate of /pressure/... and /oil_temperature, Hz of device time.",
        10.0,
        0.1,
        50.0,
    ),
    *(
        ParameterRule(o.name, f"{o.text[0].upper()}{o.text[1:]}.", o.default, o.low, o.high)
        for o in OPTIONS
    ),
)


@dataclass(frozen=True, slots=True)
class Settings:
    """The checked values of `PARAMETERS`, same names; `required_subscribers` by topic.

    `real_time` holds the values of `hydro_msgs_docs.real_time.OPTIONS`.
    `robot`, `can`, `clock`, `dbc`, `mapping`, `calibration`, `slew_limit_v_s`,
    `reenable_slew_v_s`, `max_age_ms`, `min_supply_pa` and `slow_rate_hz` are as the texts of
    `PARAMETERS` say, which `can_bridge --help` prints.
    """

    robot: str
    can: str
    dbc: str
    mapping: str
    calibration: str
    clock: str
    required_subscribers: Mapping[str, int]
    slew_limit_v_s: float
    reenable_slew_v_s: float
    max_age_ms: float
    min_supply_pa: float
    slow_rate_hz: float
    real_time: RealTimeOptions


def settings_from(values: Mapping[str, Any]) -> Settings:
    """Check parameter values.

    Parameters
    ----------
    values : mapping from parameter name to value

    Returns
    -------
    Settings

    Raises
    ------
    BridgeError, RealTimeError
        A value is none of the choices, or not what `required_subscribers` or `cpu_affinity`
        expects.
    """
    for rule in PARAMETERS:
        if rule.choices and values[rule.name] not in rule.choices:
            raise BridgeError(
                f"parameter '{rule.name}' should be one of {', '.join(rule.choices)},"
                f" found '{values[rule.name]}'"
            )
    required = _required(str(values["required_subscribers"]))
    shared = {option.name for option in OPTIONS}
    own = {name: value for name, value in values.items() if name not in shared}
    real_time = RealTimeOptions.of(values)
    return Settings(**own | {"required_subscribers": required, "real_time": real_time})


def _required(text: str) -> dict[str, int]:
    required: dict[str, int] = {}
    for word in text.replace(",", " ").split():
        topic, _, count = word.rpartition(":")
        topic = topic if topic.startswith("/") else f"/{topic}"
        if topic not in PUBLISHED_CYCLE_TOPICS or not count.isdigit():
            raise BridgeError(
                "parameter 'required_subscribers' should be 'topic:count ...' with topics of"
                f" {', '.join(PUBLISHED_CYCLE_TOPICS)}, found '{word}'"
            )
        required[topic] = int(count)
    return required


def parameter_table() -> str:
    """The parameters as a Markdown table, for the documentation."""
    lines = ["| parameter | default | range | meaning |", "|---|---|---|---|"]
    for rule in PARAMETERS:
        span = " / ".join(rule.choices)
        if rule.low is not None and rule.high is not None:
            span = f"{rule.low:g} to {rule.high:g}"
        text = str(rule.default)
        text = text.lower() if isinstance(rule.default, bool) else text
        default = f"`{text}`" if text else ""
        lines.append(f"| `{rule.name}` | {default} | {span} | {rule.text} |")
    return "\n".join(lines) + "\n"
