"""An effect's size in one number, from the parameters that a diagnosis found.

The truth plant and the catalogue write the same physics in different forms; both are brought to
the operating point that `hidden.Hidden.at` states. Forms that have no number in common have none
here, and are scored on their names alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from hydro_ident.study.hidden import FLOW_M3_S, LOAD_N, PRESSURE_PA, RATE_RAD_S, SPEED_M_S
from hydro_model.effects.mechanics import PRESSED_M

Numbers = Mapping[str, float]
Reading = Callable[[Numbers, Numbers], float]
_ABSOLUTE_PA = 1.0e6 + 101325.0
#: Between which shares of the usual signal a bent gain is compared: there a parabola and the
#: truth's form, fitted to each other, change alike (within 5 % up to signals of 0.9).
_SEEN = 0.6, 1.0
#: Step of a slope, as a share of a parameter's size or deviation.
_STEP = 1.0e-4


def _plain(*names: str, factor: float = 1.0) -> Reading:
    """Sum of some parameters' sizes, times a factor."""
    return lambda p, at: factor * sum(abs(p.get(name, 0.0)) for name in names)


def _stribeck(p: Numbers, at: Numbers) -> float:
    slow = 0.1 * SPEED_M_S
    return p["force"] * math.exp(-((slow / p["stribeck_velocity"]) ** p.get("exponent", 2.0)))


def _asymmetric(p: Numbers, at: Numbers) -> float:
    return abs(p.get("force", 0.0) + SPEED_M_S * p.get("viscous", 0.0))


def _local(p: Numbers, at: Numbers) -> float:
    stations = ("retracted", "quarter", "middle", "three_quarters", "extended")
    return max(p.get(name, 0.0) for name in stations)


def _drift(p: Numbers, at: Numbers) -> float:
    thinner = math.log(2.0) / p["halving_temperature"]
    if "rise" in p and p["rise"] != 0.0:
        rise = p["rise"] * (1.0 - math.exp(-at["duration_s"] / p["time_constant"]))
        return abs(p["viscous"] * SPEED_M_S * (1.0 - math.exp(-rise * thinner)))
    ends = [at[name] - p.get("reference", 40.0) for name in ("coldest_c", "warmest_c")]
    cold, warm = (math.exp(-end * thinner) for end in ends)
    return abs(p["viscous"] * SPEED_M_S * (cold - warm))


def _coupling(p: Numbers, at: Numbers) -> float:
    """The truth's torque levels off with the rate; ours is a line: alike at the usual rate."""
    line = abs(p.get("viscous", 0.0)) * RATE_RAD_S / at["lever"]
    return line * math.hypot(1.0, at["other_rad_s"]) / math.hypot(1.0, RATE_RAD_S)


def _contact(p: Numbers, at: Numbers) -> float:
    if p.get("way", 0.0) != 0.0:
        return math.nan  # what one joint runs against has no height
    deep = max(p["height"] - at["lowest_tip_m"], 0.0)
    return p["stiffness"] * deep * math.pow(deep / PRESSED_M, p.get("exponent", 1.0) - 1.0)


def _spring(p: Numbers, at: Numbers) -> float:
    if p.get("about", 0.0) != 0.0:
        return math.nan  # what turns the joint pushes nothing with the rod in
    return abs(p["force"])


def _air(p: Numbers, at: Numbers) -> float:
    exponent = p.get("polytropic_exponent", 1.4)
    share = math.pow(101325.0 / _ABSOLUTE_PA, 1.0 / exponent)
    soft = at["bulk_modulus_pa"] * p["fraction"] / (exponent * _ABSOLUTE_PA) * share
    return soft / (1.0 + soft)


def _gain(p: Numbers, at: Numbers) -> float:
    """How far off the opening is at half signal, of the truth's form that is found here.

    Openings are seen up to the usual signal alone, and edges take up any gain: what is compared
    is how the gain, ``1 / (1 + b |u|)`` in the truth, changes over what counts in a fit.
    """
    low, high = (share * at["signal"] for share in _SEEN)
    ratio = _bent_gain(p, high) / _bent_gain(p, low)
    truth = (1.0 - ratio) / (ratio * high - low)
    return abs(truth) / (2.0 + truth)


def _bent_gain(p: Numbers, signal: float) -> float:
    bend, knee = p["progression"], p.get("knee", 0.0)
    if knee > 0.0:
        return 1.0 + bend * max(signal - knee, 0.0) / signal
    return 1.0 + bend * (signal - 1.0)


#: By the effect's name: parameters found and the case's operating point to the size.
READINGS: dict[str, Reading] = {
    "coulomb_friction": _plain("force"),
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "pressure_dependent_friction": _plain("coefficient", factor=2.0 * PRESSURE_PA),
    "presliding_friction": _plain("force"),
    "quadratic_friction": lambda p, at: p["coefficient"] * at["fast_m_s"] ** 2,
    "position_dependent_friction": _local,
    "pin_friction": lambda p, at: p["radius"] * LOAD_N / at["lever"],
    "temperature_drift": _drift,
    "payload_change": _plain("mass"),
    "cylinder_inertia": _plain("barrel_mass", "rod_mass"),
    "structural_flexibility": lambda p, at: p["inertia"] / at["inertia_kg_m2"],
    "backlash": _plain("width"),
    "base_tilt": _plain("pitch"),
    "constant_force_offset": _plain("force"),
    "counterbalance_spring": _spring,
    "joint_coupling": _coupling,
    "external_contact": _contact,
    "encoder_offset": _plain("offset"),
    "pressure_sensor_bias": _plain("bias"),
    "pressure_sensor_gain": _plain("error"),
    "valve_deadband": _plain("width"),
    "valve_underlap": _plain("width"),
    "valve_null_bias": _plain("bias"),
    "valve_gain_nonlinearity": _gain,
    "valve_spool_lag": lambda p, at: p.get("damping", 0.8) / (math.pi * p["frequency"]),
    "valve_rate_limit": lambda p, at: 1.0 / p["rate"],
    "valve_hysteresis": _plain("half_width"),
    "internal_leakage": _plain("coefficient", factor=PRESSURE_PA),
    "external_leakage": _plain("coefficient_a", "coefficient_b", factor=PRESSURE_PA),
    "dead_volume": _plain("volume_a", "volume_b", factor=0.5),
    "entrained_air": _air,
    "supply_droop": _plain("resistance", factor=FLOW_M3_S),
    "tank_back_pressure": _plain("resistance", factor=FLOW_M3_S**2),
    "counterbalance_valve": _plain("restriction"),
    "end_cushion": _plain("strength"),
    "line_dynamics": _plain("inertance"),
    "pressure_delay": _plain("delay"),
    "command_delay": lambda p, at: p["delay"],
}


def _key(parameter: Mapping[str, Any]) -> str:
    """The parameter's own name, of `<effect>.<parameter>`."""
    return str(parameter["name"]).rpartition(".")[2]


def _owner(parameter: Mapping[str, Any]) -> str:
    """The effect that a parameter is of; empty where it does not say."""
    return str(parameter["name"]).rpartition(".")[0].rpartition(".")[2]


def found_size(name: str, parameters: list[dict[str, Any]], at: Numbers) -> float | None:
    """Size of an effect that a diagnosis names.

    Parameters
    ----------
    name : str
    parameters : list of dict
        Of the finding: `name` as `<effect>.<parameter>`, `value`.
    at : mapping of str to float
        The case's operating point.

    Returns
    -------
    float or None
        None where there is no number in common, or the finding lacks one that it takes.
    """
    reading = READINGS.get(name)
    if reading is None:
        return None
    mine = {_key(p): float(p["value"]) for p in parameters if _owner(p) in (name, "")}
    try:
        size = reading(mine, at)
        return size if math.isfinite(size) else None
    except (KeyError, ZeroDivisionError, OverflowError):
        return None


def found_interval(
    name: str,
    parameters: list[dict[str, Any]],
    at: Numbers,
    covariance: Mapping[str, Any] | None = None,
) -> tuple[float, float] | None:
    """The size's 95 % interval, to first order in the errors of the parameters behind it.

    Parameters
    ----------
    name, parameters, at
        As `found_size`; parameters have their `std`, or None where they were not fitted.
    covariance : mapping, optional
        `names` and `values` of the fitted parameters; without it they count as independent.

    Returns
    -------
    (float, float) or None
        None where there is no size, or no fitted parameter that it depends on.
    """
    size = found_size(name, parameters, at)
    if size is None:
        return None
    mine = [p for p in parameters if _owner(p) in (name, "") and p.get("std")]
    matrix = _covariance(mine, covariance)
    slopes = [_slope(name, parameters, at, p) for p in mine]
    if not any(slopes) or not all(math.isfinite(s) for s in slopes):
        return None
    variance = sum(
        a * row[j] * b for a, row in zip(slopes, matrix, strict=True) for j, b in enumerate(slopes)
    )
    half = 1.96 * math.sqrt(max(variance, 0.0))
    return size - half, size + half


def _covariance(mine: list[dict[str, Any]], given: Mapping[str, Any] | None) -> list[list[float]]:
    """Of some parameters; what is not given is that of independent ones."""
    names = list(given["names"]) if given else []

    def entry(one: dict[str, Any], other: dict[str, Any]) -> float:
        if given and one["name"] in names and other["name"] in names:
            return float(given["values"][names.index(one["name"])][names.index(other["name"])])
        return float(one["std"]) ** 2 if one is other else 0.0

    return [[entry(one, other) for other in mine] for one in mine]


def _slope(name: str, parameters: list[dict[str, Any]], at: Numbers, one: dict[str, Any]) -> float:
    """Slope of the size in one parameter; nan where the size has none there."""
    value = float(one["value"])
    step = _STEP * max(abs(value), float(one["std"]))
    ends = [
        found_size(name, [{**p, "value": value + h} if p is one else p for p in parameters], at)
        for h in (step, -step)
    ]
    if ends[0] is None or ends[1] is None:
        return math.nan
    return (ends[0] - ends[1]) / (2.0 * step)
