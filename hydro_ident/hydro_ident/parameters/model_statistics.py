"""How sure an identification is, beyond its covariance: kept in `model.yaml` for comparisons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.estimate.effects.left_out import cylinder_errors, force_errors, left_out_rms
from hydro_ident.estimate.flows.chambers import INVERSE_BULK, OVER_BULK
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.scoring.scores import ChannelScore
from hydro_ident.parameters.parameters import Parameter
from hydro_model.robot import FloatArray
from hydro_model.robot_files import read_yaml

#: Keys of `model.yaml`.
_DOF, _ERROR, _BASE_ERROR = "degrees_of_freedom", "model_error", "base_model_error"


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a comparison has to know of an identification besides values and covariance.

    Attributes
    ----------
    dof : mapping of str to float
        Degrees of freedom of the standard deviations by parameter; absent: as good as infinite.
    model_error : mapping of str to float
        Standard deviations for physics left out, by parameter
        (`hydro_ident.estimate.effects.left_out`).
    base_model_error : (p, p) array or None
        The same as a covariance of the base parameters.
    bags : mapping of str to str
        Bag names by the SHA-256 of their files.
    """

    dof: Mapping[str, float] = field(default_factory=dict)
    model_error: Mapping[str, float] = field(default_factory=dict)
    base_model_error: FloatArray | None = None
    bags: Mapping[str, str] = field(default_factory=dict)


def statistics_of(
    parameters: Sequence[Parameter],
    inertial: InertialFit | None,
    hydraulic: HydraulicFit | None,
    scores: Sequence[ChannelScore],
    bags: Mapping[str, str] | None = None,
) -> Statistics:
    """Statistics of an identification.

    Parameters
    ----------
    parameters : sequence of Parameter
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    scores : sequence of ChannelScore
    bags : mapping of str to str, optional
        Names and SHA-256 of the bags that were fitted.

    Returns
    -------
    Statistics
        Of the identifiable parameters.
    """
    left_out, base = left_out_rms(scores), None
    errors: dict[str, float] = {}
    if inertial is not None:
        covariance, count = force_errors(inertial, left_out), len(inertial.model.base.names)
        errors |= dict(zip(inertial.model.names, _deviations(covariance), strict=True))
        base = covariance[:count, :count]
    if hydraulic is not None:
        growth = [0.0]
        for cylinder in hydraulic.cylinders:
            errors |= dict(_hydraulic_errors(cylinder, left_out))
            growth += _growth(cylinder, left_out)
        # The delay is one more column of every chamber, not kept: it is as unsure as the worst.
        errors["command_delay"] = max(growth) * hydraulic.delay_std_s
    known = {p.name: p.dof for p in parameters if p.identifiable}
    return Statistics(
        {name: float(dof) for name, dof in known.items() if math.isfinite(dof)},
        {n: float(e) for n, e in errors.items() if n in known and e > 0.0 and math.isfinite(e)},
        base if base is not None and base.any() else None,
        {digest: name for name, digest in (bags or {}).items()},
    )


def statistics_dict(statistics: Statistics) -> dict[str, Any]:
    """Entries of `model.yaml`; those without content are left out."""
    data: dict[str, Any] = {}
    if statistics.dof:
        data[_DOF] = {k: float(v) for k, v in statistics.dof.items()}
    if statistics.model_error:
        data[_ERROR] = {k: float(v) for k, v in statistics.model_error.items()}
    if statistics.base_model_error is not None:
        data[_BASE_ERROR] = [[float(v) for v in row] for row in statistics.base_model_error]
    return data


def read_statistics(file: Path) -> Statistics:
    """Statistics of a `model.yaml`; empty for a robot file that was not identified.

    Parameters
    ----------
    file : Path

    Returns
    -------
    Statistics

    Raises
    ------
    RobotError
        A key is not what it should be.
    """
    top = read_yaml(file)
    size = sum(1 for _ in top.items("base_parameters"))
    origin = top.optional_fields("provenance")
    listed = [] if origin is None else list(origin.items("bags"))
    return Statistics(
        top.mapping_of_numbers(_DOF) if _DOF in top else {},
        top.mapping_of_numbers(_ERROR) if _ERROR in top else {},
        top.matrix(_BASE_ERROR, (size, size)) if _BASE_ERROR in top else None,
        {f.text("sha256"): f.text("name") for f in listed if "sha256" in f},
    )


def shared_bags(before: Statistics, now: Statistics) -> tuple[str, ...]:
    """Names of the bags that both were identified from.

    `before` and `now` are the two identifications.
    """
    return tuple(name for digest, name in now.bags.items() if digest in before.bags)


def _hydraulic_errors(
    fit: CylinderFit, left_out: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    """Deviations by the names of the result file, of what these are functions of."""
    values = dict(zip(fit.names, fit.theta.tolist(), strict=True))
    errors = dict(zip(fit.names, _deviations(cylinder_errors(fit, left_out)), strict=True))
    inverse = values[INVERSE_BULK]
    if inverse == 0.0:
        return
    for name, error in errors.items():
        if name == INVERSE_BULK and fit.refused_bulk is not None:
            continue
        if name == INVERSE_BULK:
            yield f"{fit.cylinder}.bulk_modulus", error / inverse**2
        elif name.startswith("c_"):
            yield f"{fit.valve}.{name}", error
        elif name.endswith(OVER_BULK):
            of_bulk = values[name] * errors[INVERSE_BULK] / inverse
            full = f"{fit.cylinder}.{name.removesuffix(OVER_BULK)}"
            yield full, math.hypot(error, of_bulk) / abs(inverse)
        else:
            yield f"{fit.cylinder}.{name}", error


def _growth(fit: CylinderFit, left_out: Mapping[str, float]) -> list[float]:
    """Model error over standard deviation of the edges."""
    errors = _deviations(cylinder_errors(fit, left_out))
    return [
        error / fit.value(name)[1]
        for name, error in zip(fit.names, errors, strict=True)
        if name.startswith("c_") and fit.value(name)[1] > 0.0
    ]


def _deviations(covariance: FloatArray) -> list[float]:
    roots: list[float] = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    return roots
