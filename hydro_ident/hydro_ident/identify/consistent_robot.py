"""Physically consistent link parameters of an identified robot, and what is written of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.bodies.physical import (
    BaseEstimate,
    ConsistentBody,
    PhysicalParameters,
    physical_parameters,
    told_distance,
)
from hydro_ident.estimate.forces.bounds import DEVIATIONS
from hydro_model.multibody.base_parameters import longest_link_m
from hydro_model.multibody.spatial import central_inertia
from hydro_model.robot import (
    PART_PARAMETERS,
    STANDARD_PARAMETERS,
    BaseParameter,
    FloatArray,
    Robot,
)
from hydro_model.robot_files import datasheet_inertia


@dataclass(frozen=True, slots=True)
class PhysicalResult:
    """Consistent parameters, or why they could not be computed.

    Attributes
    ----------
    parameters : PhysicalParameters or None
    problems : tuple of str
        Which bodies cannot exist as identified; why nothing was computed.
    notes : tuple of str
        Bodies whose given values were no consistent ones.
    """

    parameters: PhysicalParameters | None
    problems: tuple[str, ...]
    notes: tuple[str, ...]


def physical_result(identified: Robot, given: Robot) -> PhysicalResult:
    """The consistent parameters closest to the given robot's that reproduce an identified one.

    Parameters
    ----------
    identified : Robot
        With base parameters.
    given : Robot
        Whose links are the reference: its `standard_parameters`, or else its URDF's inertia.

    Returns
    -------
    PhysicalResult
    """
    try:
        found = physical_parameters(*_problem(identified, given), longest_link_m(given))
    except (IdentError, np.linalg.LinAlgError) as error:
        text = f"physically consistent parameters were not found: {error}"
        return PhysicalResult(None, (text,), ())
    problems = tuple(problem.text for problem in found.problems)
    if problems:
        problems += (_distance_text(found),)
    without = [body.name for body in found.bodies if not body.given]
    notes = (
        (f"{', '.join(without)}: the given inertia is not that of a body; taken as a rough size",)
        if without
        else ()
    )
    return PhysicalResult(found, problems, notes)


def _distance_text(found: PhysicalParameters) -> str:
    known = f"{told_distance(found.distance)} away" if _known(found) else "beside them"
    near = _known(found) and found.distance <= _by_noise(len(found.base))
    used = "which noise alone makes" if near else "not used"
    return (
        f"the closest base parameters that bodies can have are {known}: shown under `physical`,"
        f" {used}"
    )


def impossible(result: PhysicalResult | None) -> str:
    """That no bodies have the identified base parameters, by more than noise explains.

    Parameters
    ----------
    result : PhysicalResult or None

    Returns
    -------
    str
        A sentence; empty where there are such bodies, or they may be there.
    """
    found = None if result is None else result.parameters
    if found is None or found.feasible or not _known(found):
        return ""
    if found.distance <= _by_noise(len(found.base)):
        return ""
    names = dict.fromkeys(name for problem in found.problems for name in problem.bodies)
    return (
        f"no bodies ({', '.join(names)}) have the identified base parameters, which are"
        f" {found.distance:.0f} standard deviations from any that do: standard parameters and"
        " identified.urdf cannot be had; the machine does more than its model knows (list what"
        " `diagnose` finds of it), or the robot file is of another machine"
    )


def _by_noise(count: int) -> float:
    """Distance from the truth that noise passes as seldom as `DEVIATIONS` of one parameter."""
    from scipy.special import chdtri, ndtr

    return float(np.sqrt(chdtri(count, 2.0 * ndtr(-DEVIATIONS))))


def _known(found: PhysicalParameters) -> bool:
    """Whether distances are in standard deviations."""
    return all(np.isfinite(problem.standard_deviations) for problem in found.problems)


def _problem(identified: Robot, given: Robot) -> tuple[list[str], FloatArray, BaseEstimate]:
    rows = identified.base_parameters
    if not rows:
        raise IdentError(f"expected base parameters of {identified.name}, found none")
    values = reference_values(given)
    absent = _absent_parts(given, rows)
    rows = tuple(row for row in rows if _body_of(row.name) not in absent)
    named = {name for row in rows for name in (row.name, *row.combination)}
    named = {name for name in named if _body_of(name) not in absent}
    bodies = {_body_of(name) for name in named}
    values |= {k: v for k, v in _part_values(given).items() if _body_of(k) in bodies}
    unknown = sorted(named - set(values))
    if unknown:
        raise IdentError(f"no given value for {', '.join(unknown)}")
    names = list(values)
    combination = np.array([[row.combination.get(n, 0.0) for n in names] for row in rows])
    every = [row.name for row in identified.base_parameters]
    covariance = identified.base_covariance
    if covariance is None:
        covariance = np.zeros((len(every), len(every)))
    kept = [every.index(row.name) for row in rows]
    covariance = covariance[np.ix_(kept, kept)]
    estimate = BaseEstimate(
        tuple(row.name for row in rows),
        combination,
        np.array([row.value for row in rows]),
        np.where(np.isfinite(covariance), covariance, 0.0),
    )
    return names, np.array(list(values.values())), estimate


def _body_of(name: str) -> str:
    return name.rsplit(".", 1)[0]


def _absent_parts(given: Robot, rows: Sequence[BaseParameter]) -> set[str]:
    """Barrels and rods that the robot file does not have and nothing was found of."""
    described = {
        f"{c.name}_{kind}"
        for c in given.closed_chains
        for kind, part in (("barrel", c.barrel), ("rod", c.rod))
        if part is not None
    }
    found = {_body_of(row.name) for row in rows if row.value != 0.0}
    return {_body_of(name) for name in given.part_names} - described - found


def reference_values(robot: Robot) -> dict[str, float]:
    """Standard parameters of a robot's links as CAD, datasheet or an earlier result gave them.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    dict
        `<link>.<parameter>` in column order; zeros where nothing is known.
    """
    if robot.standard_parameters:
        return {name: robot.standard_parameters[name] for name in robot.standard_names}
    inertia = datasheet_inertia(robot).ravel()
    return dict(zip(robot.standard_names, (float(v) for v in inertia), strict=True))


def _part_values(robot: Robot) -> dict[str, float]:
    """Parameters of barrels and rods; zeros for those that the robot file does not have."""
    values = dict.fromkeys(robot.part_names, 0.0)
    for cylinder in robot.closed_chains:
        for kind, part in (("barrel", cylinder.barrel), ("rod", cylinder.rod)):
            if part is not None:
                names = [f"{cylinder.name}_{kind}.{p}" for p in PART_PARAMETERS]
                values |= dict(zip(names, part.parameters, strict=True))
    return {name: robot.standard_parameters.get(name, value) for name, value in values.items()}


def with_standard_parameters(robot: Robot, found: PhysicalParameters | None) -> Robot:
    """A robot that carries the consistent parameters beside its base parameters.

    Parameters
    ----------
    robot : Robot
    found : PhysicalParameters or None
        Taken only where they reproduce the base parameters.

    Returns
    -------
    Robot
        With the same dynamics.
    """
    values: dict[str, float] = {}
    if found is not None and found.feasible:
        for body in found.bodies:
            values |= {f"{body.name}.{k}": v for k, v in body.parameters.items()}
    return replace(robot, standard_parameters=values)


def physical_notes(result: PhysicalResult | None) -> tuple[str, ...]:
    """What the identification's notes say of it.

    Parameters
    ----------
    result : PhysicalResult or None

    Returns
    -------
    tuple of str
    """
    return () if result is None else (*result.problems, *result.notes)


def physical_dict(result: PhysicalResult | None) -> dict[str, Any] | None:
    """The key `physical` of result.json.

    Parameters
    ----------
    result : PhysicalResult or None

    Returns
    -------
    dict or None
    """
    if result is None:
        return None
    found = result.parameters
    data: dict[str, Any] = {
        "feasible": None if found is None else found.feasible,
        "links": {} if found is None else {b.name: body_dict(b) for b in found.bodies},
        "problems": list(result.problems),
    }
    if found is not None and not found.feasible:
        data["infeasible"] = [
            {
                "links": list(p.bodies),
                "standard_deviations": p.standard_deviations if _known(found) else None,
                "base_parameters": list(p.base_parameters),
            }
            for p in found.problems
        ]
        data["closest"] = {
            "standard_deviations": found.distance if _known(found) else None,
            "base_parameters": dict(zip(found.base, map(float, found.closest), strict=True)),
        }
    return data


def body_dict(body: ConsistentBody) -> dict[str, Any]:
    """Mass, centre of mass and inertia about it, beside the standard parameters.

    Parameters
    ----------
    body : ConsistentBody

    Returns
    -------
    dict
    """
    data: dict[str, Any] = {"mass_kg": body.parameters["mass"]}
    if set(body.parameters) == set(STANDARD_PARAMETERS):
        com, inertia = central(body.parameters)
        data |= {
            "com_m": [float(v) for v in com],
            "inertia_com_kg_m2": [[float(v) for v in row] for row in inertia],
        }
    return data | {
        "standard_parameters": dict(body.parameters),
        "divergence_from_given": max(body.divergence, 0.0),
        "smallest_eigenvalue": body.depth,
    }


def central(parameters: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Centre of mass and the inertia about it of the ten standard parameters.

    Parameters
    ----------
    parameters : mapping
        By the names of `STANDARD_PARAMETERS`, the mass above 0.

    Returns
    -------
    com_m : (3,) array
    inertia_com_kg_m2 : (3, 3) array
    """
    theta = np.array([parameters[name] for name in STANDARD_PARAMETERS])
    com, about_com = central_inertia(theta)
    # Differences of equal numbers, such as products of inertia in a plane of symmetry.
    trace = parameters["ixx"] + parameters["iyy"] + parameters["izz"]
    about_com[np.abs(about_com) < 1e-13 * trace] = 0.0
    return com, about_com
