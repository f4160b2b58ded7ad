"""The parameters of the controller node, declared once: descriptors and docs come from here."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from hydro_control.adaptation.adaptation_settings import KINDS, AdaptationSettings, kinds_of
from hydro_control.gains import Gains
from hydro_control.monitoring.following_error import FollowingLimits
from hydro_control.monitoring.runaway import RunawayLimits
from hydro_control.motion.motion_limits import TIP_SPEED_M_S
from hydro_msgs_docs.node_parameters import ParameterRule, table_of, values_of
from hydro_msgs_docs.real_time import OPTIONS, RealTimeOptions

_GAINS = Gains()
_ADAPT = AdaptationSettings()
_RUNAWAY = RunawayLimits()
_FOLLOWING = FollowingLimits()

PARAMETERS = (
    ParameterRule("robot", "xs031", "", "a *.hydraulics.yaml or model.yaml, or a shipped robot"),
    ParameterRule(
        "path", "", "", "path file, or a shipped path, played after activation; empty: hold"
    ),
    ParameterRule(
        "start_delay_s",
        1.0,
        "s",
        "hold before the path, the approach to its start included",
        0,
        60,
    ),
    ParameterRule(
        "required_recorders",
        0,
        "",
        "recorders to wait for, beside the bridge, before the first answer",
        0,
        16,
    ),
    ParameterRule(
        "k_p_1_s", _GAINS.k_p_1_s, "1/s", "position error to required velocity (eq. 19)", 0, 100
    ),
    ParameterRule(
        "k_v",
        _GAINS.k_v,
        "N m s and N s/m",
        "velocity error of a link to required force, angular and linear alike (eq. 20)",
        0,
        1e6,
    ),
    ParameterRule(
        "k_f_m2_ns", _GAINS.k_f_m2_ns, "m^2/(N s)", "force error to flow term (eq. 23)", 0, 1e-5
    ),
    ParameterRule("k_x_m", _GAINS.k_x_m, "m", "piston velocity error to flow term (eq. 23)", 0, 1),
    ParameterRule("alpha_q", _GAINS.alpha_q, "", "filter weight of joint position", 1e-3, 1),
    ParameterRule("alpha_qd", _GAINS.alpha_qd, "", "filter weight of joint velocity", 1e-3, 1),
    ParameterRule("alpha_p", _GAINS.alpha_p, "", "filter weight of chamber pressures", 1e-3, 1),
    ParameterRule(
        "alpha_fd", _GAINS.alpha_fd, "", "filter weight of the required force's rate", 1e-3, 1
    ),
    ParameterRule(
        "slew_limit_v_s",
        _GAINS.slew_limit_v_s,
        "V/s",
        "greatest change of a valve voltage; keep at or below the bridge's",
        1,
        1e5,
    ),
    ParameterRule(
        "tip_speed_limit_m_s",
        TIP_SPEED_M_S,
        "m/s",
        "greatest tip speed: paths beyond it are refused, faster required motion is slowed",
        0.01,
        20,
    ),
    ParameterRule(
        "fault_end_share",
        _RUNAWAY.end_share,
        "",
        "0 V where a joint is measured beyond its end, or further out than where it began, by more"
        " than this share of its range; latched",
        1e-3,
        0.09,
    ),
    ParameterRule(
        "fault_speed_factor",
        _RUNAWAY.speed_factor,
        "",
        "0 V where a joint or the tip is measured faster than its limit times this, the tip by"
        " 0.2 m/s at least; latched",
        1.1,
        10,
    ),
    ParameterRule(
        "following_error_share",
        _FOLLOWING.error_share,
        "",
        "a joint further from where it shall be than this share of its range, and without headway"
        " for `following_error_s`, ends the motion: the arm is held where it is (blocked, or"
        " without power); what was only held is at 0 V, latched",
        0.005,
        1,
    ),
    ParameterRule(
        "following_error_s",
        _FOLLOWING.time_s,
        "s",
        "time without headway after which the motion ends; headway is a twentieth of what the"
        " joint's velocity limit allows in that time",
        0.05,
        60,
    ),
    ParameterRule(
        "adaptation",
        "",
        "",
        f"what is adapted online, some of: {', '.join(KINDS)}; empty: nothing",
    ),
    ParameterRule(
        "adapt_payload_kg",
        _ADAPT.payload_kg,
        "kg",
        "largest payload at the tip beyond the model's, either sign",
        1,
        1e4,
    ),
    ParameterRule(
        "adapt_coulomb_n", _ADAPT.coulomb_n, "N", "largest Coulomb friction of a cylinder", 1, 1e5
    ),
    ParameterRule(
        "adapt_viscous",
        _ADAPT.viscous,
        "N s/m",
        "largest change of a cylinder's viscous friction, either way",
        1,
        1e6,
    ),
    ParameterRule(
        "adapt_null_bias",
        _ADAPT.null_bias,
        "",
        "largest null bias of a valve, either sign, normalised",
        1e-4,
        0.2,
    ),
    ParameterRule(
        "adapt_ramp_s",
        _ADAPT.ramp_s,
        "s",
        "shortest time from 0 to the largest value that the law uses",
        0.1,
        60,
    ),
    ParameterRule(
        "adapt_dead_zone_n",
        _ADAPT.dead_zone_n,
        "N",
        "force errors up to this size change no estimate",
        0,
        1e5,
    ),
    *OPTIONS,
)


def markdown_table() -> str:
    """The parameters as a Markdown table, for the docs."""
    return table_of(PARAMETERS)


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
    values = values_of(node, PARAMETERS)
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
