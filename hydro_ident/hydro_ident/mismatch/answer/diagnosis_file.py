"""result.json of `diagnose`: the contract's keys, and what stands behind them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hydro_ident.estimate.scoring.scores import fit_percent
from hydro_ident.identify.results import Provenance
from hydro_ident.identify.validation_results import channel_rollout, free_run_dict
from hydro_ident.json_numbers import finite
from hydro_ident.mismatch.answer.outcome import ChannelResult, Diagnosis, Finding
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.modelling.refinement import Refinement
from hydro_ident.mismatch.rows.modelled import same
from hydro_ident.mismatch.rows.off_centre import OffCentre
from hydro_ident.mismatch.rows.onset import idle_edges
from hydro_ident.mismatch.settings import FORM_TOLERANCE
from hydro_ident.mismatch.trials.contender import Contender, shape_at_an_end
from hydro_ident.mismatch.trials.where import where_of
from hydro_ident.mismatch.unnamed.unknown_file import unexplained_dict
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

SCHEMA = "hydro_ident/diagnosis/1"
#: Entries of the list of located dependences.
_LOCATED = 12


def result_json(found: Diagnosis, origin: Provenance) -> str:
    """result.json as text: the same input gives the same text.

    `origin` says where the numbers come from.
    """
    return json.dumps(result_dict(found, origin), indent=1, allow_nan=False) + "\n"


def result_dict(found: Diagnosis, origin: Provenance) -> dict[str, Any]:
    """The content of result.json.

    Parameters
    ----------
    found : Diagnosis
    origin : Provenance

    Returns
    -------
    dict
        The contract's keys; `off_centre` (errors of position sensors that were taken out of the
        recordings), `training` (scores on the rows fitted), `recordings`, `located`, `rejected`,
        `losses`, `free_run`, `problems`, `notes` and `provenance` are added, where it was asked
        for `refinement`, and to every finding what verified it and its parameters' `covariance`.
    """
    return {
        "schema": SCHEMA,
        "verdict": found.verdict,
        "robot": found.given.name,
        "channels": _channels(found),
        "training": {one.name: channel_dict(one) for one in found.fitted},
        "recordings": [one.as_dict() for one in found.recordings],
        "findings": [finding_dict(found, one) for one in found.findings],
        "unexplained": [unexplained_dict(one) for one in found.unexplained],
        "off_centre": [] if found.work is None else [_off_dict(found, e) for e in found.work.off],
        "not_testable": [{"name": n.name, "why": n.why} for n in found.not_testable],
        "located": [_located_dict(d) for d in found.located[:_LOCATED]],
        "rejected": [
            {
                "names": list(f.named.names),
                "target": f.named.term.target,
                "reason": f.verification.reason,
            }
            for f in found.rejected
        ],
        "losses": [
            {"bag": loss.bag, "channel": loss.channel, "reason": loss.reason}
            for loss in found.losses
        ],
        "free_run": free_run_dict(found.free_run),
        **({} if found.refinement is None else {"refinement": refinement_dict(found.refinement)}),
        "problems": list(found.problems),
        "notes": list(found.notes),
        "provenance": origin.as_dict(),
    }


def _channels(found: Diagnosis) -> dict[str, Any]:
    return {
        one.name: {**channel_dict(one), **channel_rollout(found.free_run, one.name)}
        for one in found.channels
    }


def channel_dict(one: ChannelResult) -> dict[str, float | int | str]:
    """The numbers of a channel."""
    spread = float(np.sum((one.measured - one.measured.mean()) ** 2))
    before = float(np.sum((one.measured - one.before) ** 2))
    after = float(np.sum((one.measured - one.after) ** 2))
    count = max(one.measured.size, 1)
    return {
        "unit": one.unit,
        "rows": int(one.measured.size),
        "rmse_before": math.sqrt(before / count),
        "rmse_after": math.sqrt(after / count),
        "noise_floor": one.noise_floor,
        "fit_before_pct": fit_percent(before, spread),
        "fit_after_pct": fit_percent(after, spread),
    }


def finding_dict(found: Diagnosis, one: Finding) -> dict[str, Any]:
    """A finding as the contract lists it, with its target and what verified it."""
    named, check = one.named, one.verification
    fitted, term = as_modelled(found, one)
    place = {"variable": "everywhere", "low": 0.0, "high": 0.0, "text": ""}
    if found.work is not None:
        where = where_of(found.work.training, fitted.model, term, one.channels[0])
        place = {
            "variable": where.variable,
            "low": where.low,
            "high": where.high,
            "text": where.text,
        }
    effect = term.effect
    return {
        "channel": one.channels[0],
        "also": list(channels_told(one.channels, named.names)[1:]),
        "target": named.term.target,
        "where": place,
        "names": list(named.names),
        # Shares that were divided by their sum may add up to a last digit above one.
        "probability": [min(p, 1.0) for p in named.probability],
        "p_value": named.p_value,
        "equation": effect.equation,
        "parameters": parameters_of(fitted, term),
        "covariance": covariance_of(fitted, term),
        "heldout_rmse_before": check.before.get(one.channels[0]),
        "heldout_rmse_after": check.after.get(one.channels[0]),
        "heldout_p_value": check.p_value,
        "heldout_exercised": not check.silent,
        "placebo_share": check.placebo,
        "agreement": [
            {
                "name": a.name,
                "unit": a.unit,
                "training": a.training,
                "held_out": a.held_out,
                "std": a.std,
            }
            for a in check.agreement
        ],
        "separating_experiment": effect.separating_experiment,
        "modelled_as": named.term.effect.name,
    }


def channels_told(channels: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Where a finding is said to show: strongest first, and in `timing` what may be a lag.

    A lag between signals has no balance of its own: it shows in those of forces and flows.

    Parameters
    ----------
    channels : sequence of str
        Whose residuals it takes from.
    names : sequence of str
        Effects of its set.

    Returns
    -------
    tuple of str
    """
    lags = any(CATALOGUE[name].channel == "timing" for name in names)
    return (*channels, "timing") if lags else tuple(channels)


def as_modelled(found: Diagnosis, one: Finding) -> tuple[Fitted | Weighed, ActiveEffect]:
    """The first name's law as it stands in the final model, else as it was weighed."""
    return _standing(found, one.named.first)


def law_of_model(found: Diagnosis, one: Finding) -> dict[str, Any]:
    """The law that stands in model.yaml for a finding, whatever this is named after.

    Parameters
    ----------
    found : Diagnosis
    one : Finding
        Of these.

    Returns
    -------
    dict
        `equation`, `parameters` and `covariance` as of `finding_dict`.
    """
    fitted, term = _standing(found, one.named.modelled)
    return {
        "equation": term.effect.equation,
        "parameters": parameters_of(fitted, term),
        "covariance": covariance_of(fitted, term),
    }


def _standing(found: Diagnosis, one: Contender) -> tuple[Fitted | Weighed, ActiveEffect]:
    """An effect as it stands in the final model, else as it was weighed."""
    if found.whole is not None:
        for term in found.whole.model.terms:
            if same(term, one.term):
                return found.whole, term
    return one.fitted, one.term


def parameters_of(fitted: Fitted | Weighed, term: ActiveEffect) -> list[dict[str, Any]]:
    """Parameters of an effect with their deviations.

    These are robust against dependence in blocks, and hold what the form of a law, which is an
    idealisation, is off by. A shape that ran to the end of its range has none: no slope tells how
    far from there it may be. Nor has what stands at zero as no row knows it.
    """
    std = np.sqrt(np.maximum(np.diag(_covariance(fitted, term)), 0.0))
    result, idle = [], idle_edges(term)
    rows = zip(term.effect.parameters, term.parameters, term.units, strict=True)
    for spec, value, unit in (row for row in rows if row[0].name not in idle):
        name = f"{term.target}.{term.effect.name}.{spec.name}"
        size = None if shape_at_an_end(spec, value) else _deviation(fitted, std, name)
        result.append(
            {
                "name": f"{term.effect.name}.{spec.name}",
                "value": float(value),
                "std": size,
                "unit": unit,
            }
        )
    return result


def covariance_of(fitted: Fitted | Weighed, term: ActiveEffect) -> dict[str, Any]:
    """Covariance of those parameters of an effect that were fitted, as their deviations.

    Returns
    -------
    dict
        `names` as in `parameters_of`, and `values`, (k, k) rows, of what has a deviation.
    """
    matrix, at, names = _covariance(fitted, term), list[int](), list[str]()
    for spec, value in zip(term.effect.parameters, term.parameters, strict=True):
        name = f"{term.target}.{term.effect.name}.{spec.name}"
        if name in fitted.names and not shape_at_an_end(spec, value):
            k = fitted.names.index(name)
            if 0.0 < matrix[k, k] < math.inf:
                at.append(k)
                names.append(f"{term.effect.name}.{spec.name}")
    return {"names": names, "values": matrix[np.ix_(at, at)].tolist()}


def _covariance(fitted: Fitted | Weighed, term: ActiveEffect) -> FloatArray:
    matrix = fitted.covariance.copy()
    for spec, value in zip(term.effect.parameters, term.parameters, strict=True):
        name = f"{term.target}.{term.effect.name}.{spec.name}"
        if name in fitted.names:
            k = fitted.names.index(name)
            matrix[k, k] += (FORM_TOLERANCE * float(value)) ** 2
    return matrix


def _deviation(fitted: Fitted | Weighed, std: FloatArray, name: str) -> float | None:
    if name not in fitted.names:
        return None
    return finite(float(std[fitted.names.index(name)])) or None


def refinement_dict(one: Refinement) -> dict[str, Any]:
    """What roll-outs made of the effects' parameters, and whether it was taken."""
    return {
        "accepted": one.accepted,
        "reason": one.reason,
        "windows": one.windows,
        "held_out_windows": one.held_out_windows,
        "rollouts": one.rollouts,
        "p_value": one.p_value,
        "rollout_rmse": {n: {"before": b, "after": a} for n, (b, a) in one.rmse.items()},
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "before": p.before,
                "before_std": finite(p.before_std),
                "value": p.value,
                "std": finite(p.std),
                "ci95": [finite(end) for end in p.ci95],
            }
            for p in one.parameters
        ],
    }


def _off_dict(found: Diagnosis, one: OffCentre) -> dict[str, Any]:
    """The error of a position sensor, by the equation of `mismatch.rows.off_centre`."""
    joint = found.given.joints[one.joint]
    return {
        "joint": joint.name,
        "sine": one.sine,
        "cosine": one.cosine,
        "period": one.period,
        "amplitude": one.amplitude,
        "std": finite(one.std),
        "unit": "m" if joint.prismatic else "rad",
    }


def _located_dict(d: Dependence) -> dict[str, Any]:
    return {
        "channel": d.name,
        "variable": d.variable,
        "times": d.times,
        "p_value": d.p_value,
        "share_of_residual": d.share,
    }
