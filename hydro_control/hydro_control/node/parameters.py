"""The parameters of the controller node, declared once: descriptors and docs come from here."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from hydro_control.adaptation.adaptation_settings import KINDS, AdaptationSettings, kinds_of
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.following_error import FollowingLimits
from hydro_control.monitoring.runaway import RunawayLimits
from hydro_control.motion.motion_limits import TIP_SPEED_M_S
from hydro_msgs_docs.real_time import OPTIONS, RealTimeOptions

Value = str | int | float | bool


@dataclass(frozen=True, slots=True)
class Parameter:
    """One ROS parameter.

    Attributes
    ----------
    name : str
    default : str, int, float or bool
        Its type is the parameter's.
    unit : str
    text : str
    lower, upper : float
        Range of a number, both included; NaN where there is none.
    """

    name: str
    default: Value
    unit: str
    text: str
    lower: float = float("nan")
    upper: float = float("nan")


_GAINS = Gains()
_ADAPT = AdaptationSettings()
_RUNAWAY = RunawayLimits()
_FOLLOWING = FollowingLimits()

PARAMETERS = (
    Parameter("robot", "xs031", "", "a *.hydraulics.yaml or model.yaml, or a shipped robot"),
    Parameter(
        "path", "", "", "path file, or a shipped path, played after activation; empty: hold"
    ),
    Parameter(
        "start_delay_s",
        1.0,
        "s",
        "hold before the path, the approach to its start included",
        0,
        60,
    ),
    Parameter(
        "required_recorders",
        0,
        "",
        "recorders to wait for, beside the bridge, before the first answer",
        0,
        16,
    ),
    Parameter(
        "k_p_1_s", _GAINS.k_p_1_s, "1/s", "position error to required velocity (eq. 19)", 0, 100
    ),
    Parameter(
        "k_v",
        _GAINS.k_v,
        "N m s and N s/m",
        "velocity error of a link to required force, angular and linear alike (eq. 20)",
        0,
        1e6,
    ),
    Parameter(
        "k_f_m2_ns", _GAINS.k_f_m2_ns, "m^2/(N s)", "force error to flow term (eq. 23)", 0, 1e-5
    ),
    Parameter("k_x_m", _GAINS.k_x_m, "m", "piston velocity error to flow term (eq. 23)", 0, 1),
    Parameter("alpha_q", _GAINS.alpha_q, "", "filter weight of joint position", 1e-3, 1),
    Parameter("alpha_qd", _GAINS.alpha_qd, "", "filter weight of joint velocity", 1e-3, 1),
    Parameter("alpha_p", _GAINS.alpha_p, "", "filter weight of chamber pressures", 1e-3, 1),
    Parameter(
        "alpha_fd", _GAINS.alpha_fd, "", "filter weight of the required force's rate", 1e-3, 1
    ),
    Parameter(
        "slew_limit_v_s",
        _GAINS.slew_limit_v_s,
        "V/s",
        "greatest change of a valve voltage; keep at or below the bridge's",
        1,
        1e5,
    ),
    Parameter(
        "tip_speed_limit_m_s",
        TIP_SPEED_M_S,
        "m/s",
        "greatest tip speed: paths beyond it are refused, faster required motion is slowed",
        0.01,
        20,
    ),
    Parameter(
        "fault_end_share",
        _RUNAWAY.end_share,
        "",
        "0 V where a joint is measured beyond its end, or further out than where it began, by more"
        " than this share of its range; latched",
        1e-3,
        0.09,
    ),
    Parameter(
        "fault_speed_factor",
        _RUNAWAY.speed_factor,
        "",
        "0 V where a joint or the tip is measured faster than its limit times this, the tip by"
        " 0.2 m/s at least; latched",
        1.1,
        10,
    ),
    Parameter(
        "following_error_share",
        _FOLLOWING.error_share,
        "",
        "a joint further from where it shall be than this share of its range, and without headway"
        " for `following_error_s`, ends the motion: the arm is held where it is (blocked, or"
        " without power); what was only held is at 0 V, latched",
        0.005,
        1,
    ),
    Parameter(
        "following_error_s",
        _FOLLOWING.time_s,
        "s",
        "how long; headway is a twentieth of what the joint's velocity limit allows in that time",
        0.05,
        60,
    ),
    Parameter(
        "adaptation",
        "",
        "",
        f"what is adapted online, some of: {', '.join(KINDS)}; empty: nothing",
    ),
    Parameter(
        "adapt_payload_kg",
        _ADAPT.payload_kg,
        "kg",
        "largest payload at the tip beyond the model's, either sign",
        1,
        1e4,
    ),
    Parameter(
        "adapt_coulomb_n", _ADAPT.coulomb_n, "N", "largest Coulomb friction of a cylinder", 1, 1e5
    ),
    Parameter(
        "adapt_viscous",
        _ADAPT.viscous,
        "N s/m",
        "largest change of a cylinder's viscous friction, either way",
        1,
        1e6,
    ),
    Parameter(
        "adapt_null_bias",
        _ADAPT.null_bias,
        "",
        "largest null bias of a valve, either sign, normalised",
        1e-4,
        0.2,
    ),
    Parameter(
        "adapt_ramp_s",
        _ADAPT.ramp_s,
        "s",
        "shortest time from 0 to the largest value that the law uses",
        0.1,
        60,
    ),
    Parameter(
        "adapt_dead_zone_n",
        _ADAPT.dead_zone_n,
        "N",
        "force errors up to this size change no estimate",
        0,
        1e5,
    ),
    *(
        Parameter(o.name, o.default, "", o.text)
        if o.low is None or o.high is None
        else Parameter(o.name, o.default, "", o.text, o.low, o.high)
        for o in OPTIONS
    ),
)


def markdown_table() -> str:
    """The parameters as a Markdown table, for the docs."""
    lines = ["| parameter | type | default | range | unit | what |", "|---|---|---|---|---|---|"]
    for p in PARAMETERS:
        span = "" if p.lower != p.lower else f"{p.lower:g} to {p.upper:g}"
        text = str(p.default)
        text = text.lower() if isinstance(p.default, bool) else text
        default = f"`{text}`" if text else "(empty)"
        kind = {str: "string", int: "integer", float: "double", bool: "boolean"}[type(p.default)]
        lines.append(f"| `{p.name}` | {kind} | {default} | {span} | {p.unit} | {p.text} |")
    return "\n".join(lines) + "\n"


def declare(node: Any) -> None:
    """Declare the parameters on a node.

    Parameters
    ----------
    node : rclpy.node.Node

    Raises
    ------
    ControlError
        A given value has the wrong type or lies outside its range.
    """
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
    from rclpy.exceptions import (
        InvalidParameterTypeException,
        InvalidParameterValueException,
        ParameterUninitializedException,
    )

    for p in PARAMETERS:
        unit = f" [{p.unit}]" if p.unit else ""
        descriptor = ParameterDescriptor(name=p.name, description=p.text + unit)
        if type(p.default) is int:
            span = IntegerRange(from_value=int(p.lower), to_value=int(p.upper), step=1)
            descriptor.integer_range = [span]
        elif isinstance(p.default, float):
            limits = {"from_value": float(p.lower), "to_value": float(p.upper), "step": 0.0}
            descriptor.floating_point_range = [FloatingPointRange(**limits)]
        try:
            node.declare_parameter(p.name, p.default, descriptor)
        except (
            InvalidParameterTypeException,
            InvalidParameterValueException,
            ParameterUninitializedException,
        ) as error:
            found = node._parameter_overrides.get(p.name)
            value = "a wrong type" if found is None else repr(found.value)
            raise ControlError(
                f"parameter {p.name} should be {_expected(p)}, found {value}"
            ) from error


def _expected(p: Parameter) -> str:
    if isinstance(p.default, str):
        return "a text"
    if isinstance(p.default, bool):
        return "true or false"
    kind = "an integer" if isinstance(p.default, int) else "a number with a decimal point"
    return f"{kind} from {p.lower:g} to {p.upper:g}"


@dataclass(frozen=True, slots=True)
class Settings:
    """The values of the parameters.

    Attributes
    ----------
    robot, path : str
    start_delay_s : float
    required_recorders : int
    gains : Gains
    tip_speed_limit_m_s : float
    runaway : RunawayLimits
    following : FollowingLimits
    adaptation : AdaptationSettings
    real_time : RealTimeOptions
    """

    robot: str
    path: str
    start_delay_s: float
    required_recorders: int
    gains: Gains
    tip_speed_limit_m_s: float
    runaway: RunawayLimits
    following: FollowingLimits
    adaptation: AdaptationSettings
    real_time: RealTimeOptions


def read(node: Any) -> Settings:
    """The parameters as they stand on a node.

    Parameters
    ----------
    node : rclpy.node.Node

    Returns
    -------
    Settings

    Raises
    ------
    ControlError
        `adaptation` names what cannot be adapted, or a value is out of what settings allow.
    RealTimeError
        `cpu_affinity` is no list of cores.
    """
    values = {p.name: node.get_parameter(p.name).value for p in PARAMETERS}
    return Settings(
        robot=values["robot"],
        path=values["path"],
        start_delay_s=values["start_delay_s"],
        required_recorders=values["required_recorders"],
        gains=Gains(**{f.name: values[f.name] for f in fields(Gains)}),
        tip_speed_limit_m_s=values["tip_speed_limit_m_s"],
        runaway=RunawayLimits(values["fault_end_share"], values["fault_speed_factor"]),
        following=FollowingLimits(values["following_error_share"], values["following_error_s"]),
        adaptation=AdaptationSettings(
            kinds=kinds_of(values["adaptation"]),
            **{
                f.name: values[f"adapt_{f.name}"]
                for f in fields(AdaptationSettings)
                if f.name != "kinds"
            },
        ),
        real_time=RealTimeOptions.of(values),
    )
