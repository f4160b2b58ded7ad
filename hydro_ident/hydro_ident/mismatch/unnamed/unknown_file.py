"""Dependence without a name as result.json has it."""

from __future__ import annotations

from typing import Any

from hydro_ident.json_numbers import finite
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.unnamed.describe import Form
from hydro_ident.mismatch.unnamed.unknown import TakenOut, Unexplained


def unexplained_dict(one: Unexplained) -> dict[str, Any]:
    """A dependence that has no name, with its curve and its short form.

    The curve is as it was fitted, together with the base, and the form is one of it. It may hold
    a part that the base swallows; what the base takes of it depends on more than the variable, so
    there is no curve without that part. Its share, and the size in its text, are of the rest.

    Parameters
    ----------
    one : Unexplained

    Returns
    -------
    dict
        An entry of the contract's `unexplained`, with more beside its keys.
    """
    d = one.dependence
    return {
        "channel": one.channel,
        "depends_on": list(one.depends_on),
        "share_of_residual": one.share,
        "where": {
            "variable": d.variable,
            "low": float(d.knots[0]),
            "high": float(d.knots[-1]),
            "text": one.text,
        },
        "text": one.text,
        "p_value": one.p_value,
        "confirmed": one.confirmed,
        "curve": _curve(d),
        "form": None if one.form is None else _form(one.form),
        "taken_out": None if one.taken_out is None else _taken_out(one.taken_out),
    }


def _taken_out(one: TakenOut) -> dict[str, Any]:
    return {
        "text": one.text,
        "rmse_before": finite(one.before),
        "rmse_after": finite(one.after),
    }


def _form(one: Form) -> dict[str, Any]:
    """A short form, with those that do equally well."""
    return {
        "name": one.name,
        "text": one.text,
        "variable": one.variable,
        "values": [
            {"name": v.name, "value": v.value, "std": v.std, "unit": v.unit} for v in one.values
        ],
        "share_of_curve": {"training": one.share, "held_out": one.held_share},
        "held_out_p_value": one.held_p_value,
        "equally_good": [_form(other) for other in one.others],
    }


def _curve(d: Dependence) -> dict[str, Any]:
    return {
        "variable": d.variable,
        "times": d.times,
        "at": [float(v) for v in d.knots],
        "value": [float(v) for v in d.curve],
    }
