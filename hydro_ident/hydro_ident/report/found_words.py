"""Findings against the model that was written: which law stands in it, what was not to be seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hydro_ident.mismatch.answer.not_testable import NotTestable
from hydro_ident.mismatch.answer.outcome import Diagnosis

#: What numbers without a unit are shares of, by effect and parameter.
_SHARES = {
    "valve_deadband.width": "full opening",
    "valve_underlap.width": "full opening",
    "valve_null_bias.bias": "full opening",
    "valve_hysteresis.half_width": "full opening",
    "valve_hysteresis.travel": "full opening",
    "valve_gain_nonlinearity.knee": "full opening",
    "position_dependent_friction.begin": "the stroke",
    "position_dependent_friction.end": "the stroke",
    "pressure_sensor_gain.error": "the reading",
    "entrained_air.fraction": "the volume",
}


def as_share(name: str, value: float) -> str:
    """A number without a unit in per cent of what it is a share of; empty where it is of nothing.

    Parameters
    ----------
    name : str
        Effect and parameter, `valve_deadband.width`.
    value : float
    """
    of = _SHARES.get(name)
    return "" if of is None else f"{100.0 * value:.3g} % of {of}"


def law_in_model(data: Mapping[str, Any]) -> str:
    """The law that stands in model.yaml for a finding, where it is not the one it is named after.

    Parameters
    ----------
    data : mapping
        The finding as the result file has it.

    Returns
    -------
    str
        An effect's identifier, or empty.
    """
    modelled = str(data["modelled_as"])
    return "" if modelled == data["names"][0] else modelled


def corners(data: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What recordings tell of a lag that is damped beyond 1: where its slower pole is.

    To first order that is frequency / (2 damping). Its quicker pole hardly shows, so that
    frequency and damping may be vague, both, where this is well known.

    Parameters
    ----------
    data : mapping
        The finding as the result file has it.

    Returns
    -------
    list of dict
        As the finding's parameters; empty where nothing lags so.
    """
    found, known = [], {p["name"]: p for p in data["parameters"]}
    for name, frequency in known.items():
        effect, _, own = name.rpartition(".")
        damping = known.get(f"{effect}.damping")
        if own != "frequency" or damping is None or not damping["value"] > 1.0:
            continue
        value = frequency["value"] / (2.0 * damping["value"])
        slopes = {name: value / frequency["value"], damping["name"]: -value / damping["value"]}
        slope = np.array([slopes.get(n, 0.0) for n in data["covariance"]["names"]])
        std = None
        if slope.any():
            variance = slope @ np.array(data["covariance"]["values"]) @ slope
            std = math.sqrt(max(float(variance), 0.0))
        text = f"{name} / (2 damping)"
        found.append({"name": text, "value": value, "std": std, "unit": frequency["unit"]})
    return found


def not_shown(found: Diagnosis) -> list[NotTestable]:
    """What recordings could not have shown, without the laws that the model has.

    A law may stand in the model for a finding that bears another one's name, or have been in the
    robot's file.

    Parameters
    ----------
    found : Diagnosis
    """
    modelled = {one.named.term.effect.name for one in found.findings}
    modelled |= {effect.name for effect in found.given.effects}
    return [one for one in found.not_testable if one.name not in modelled]
