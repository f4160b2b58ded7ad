"""The parameters of `can_bridge`, described once: declared from here, documented from here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hydro_hw_bridge.bus.bus_name import DEFAULT_BUS
from hydro_hw_bridge.errors import BridgeError
from hydro_msgs_docs.node_parameters import ParameterRule, check_choices, table_of
from hydro_msgs_docs.real_time import OPTIONS, RealTimeOptions
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_STATE

REAL_TIME, LOCKSTEP = "real_time", "lockstep"
#: Of `CYCLE_TOPICS` those that the bridge publishes.
PUBLISHED_CYCLE_TOPICS = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_STATE)


PARAMETERS = (
    ParameterRule("robot", "xs031", "", "robot file, or name of a shipped robot"),
    ParameterRule("can", DEFAULT_BUS, "", "CAN bus as interface:channel[:port]"),
    ParameterRule("dbc", "", "", "DBC file; empty: the one that the mapping names"),
    ParameterRule("mapping", "", "", "mapping file; empty: the one shipped for the robot"),
    ParameterRule("calibration", "", "", "calibration file; empty: the mapping's own values"),
    ParameterRule(
        "clock",
        REAL_TIME,
        "",
        "real_time: the device runs by itself; lockstep: each cycle waits for its answer",
        choices=(REAL_TIME, LOCKSTEP),
    ),
    ParameterRule(
        "required_subscribers",
        "",
        "",
        "subscribers to wait for before driving, as 'topic:count ...', such as"
        " '/joint_states:2 /chamber_pressures:2 /valve_state:2'; empty: none",
    ),
    ParameterRule(
        "slew_limit_v_s",
        1000.0,
        "V/s",
        "legal slew rate of a valve voltage; the gate trips above twice that",
        1,
        1e5,
    ),
    ParameterRule(
        "reenable_slew_v_s",
        10.0,
        "V/s",
        "slew rate of the output in the first second of driving after a trip was cleared",
        1,
        1e5,
    ),
    ParameterRule(
        "max_age_ms",
        10.0,
        "ms",
        "age of a command at which the gate trips, device time; two cycles of the device or more",
        2,
        50,
    ),
    ParameterRule(
        "min_supply_pa",
        2.0e6,
        "Pa",
        "supply pressure, gauge, below which the gate trips; 0: not checked",
        0,
        40.0e6,
    ),
    ParameterRule(
        "slow_rate_hz",
        10.0,
        "Hz",
        "rate of /pressure/... and /oil_temperature, device time",
        0.1,
        50,
    ),
    *OPTIONS,
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
    ParameterError, BridgeError, RealTimeError
        A value is none of the choices, or not what `required_subscribers` or `cpu_affinity`
        expects.
    """
    check_choices(PARAMETERS, values)
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


def markdown_table() -> str:
    """The parameters as a Markdown table, for the documentation."""
    return table_of(PARAMETERS)
