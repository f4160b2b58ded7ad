"""A robot with identified numbers in the place of the given ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.parameters.parameters import Parameter, parameter_list
from hydro_ident.robots.robot_ranges import least_inertia
from hydro_model.effects.catalogue import resolve
from hydro_model.multibody.base_parameters import with_base
from hydro_model.robot import (
    BaseParameter,
    Cylinder,
    EffectSpec,
    Robot,
    Valve,
)


def identified_robot(
    robot: Robot,
    inertial: InertialFit | None,
    hydraulic: HydraulicFit | None,
    biases: Mapping[str, float] | None = None,
) -> Robot:
    """Put what was identified into a robot; what was rejected stays as given.

    Parameters
    ----------
    robot : Robot
    inertial : InertialFit or None
        Base parameters that are not identifiable stay as given; so do all of them with None or
        where they were rejected.
    hydraulic : HydraulicFit or None
    biases : mapping of str to float, optional
        Fitted null biases of the valves.

    Returns
    -------
    Robot
        Its leading standard parameters carry the base parameters, the others are zero. Rows of
        `base_covariance` are zero for base parameters that stayed as given.
    """
    accepted = replace_rejected(hydraulic)
    if inertial is not None and inertial.rejected:
        inertial = None
    found = parameter_list(robot, inertial, accepted, biases)
    values = {p.name: p for p in found if p.identifiable or p.held}
    base_names = () if inertial is None else inertial.model.base.names
    deviations = {
        name: float(p.std)
        for name, p in values.items()
        if p.identifiable and name not in base_names and math.isfinite(p.std)
    }
    joints = tuple(
        replace(
            j,
            viscous_friction=_value(values, f"{j.name}.viscous_friction", j.viscous_friction),
        )
        for j in robot.joints
    )
    if inertial is not None:
        robot = with_fitted_base(robot, inertial)
    return replace(
        robot,
        joints=joints,
        standard_deviations=deviations,
        cylinders=tuple(_cylinder(c, values) for c in robot.cylinders),
        valves=tuple(_valve(v, values) for v in robot.valves),
        command_delay_s=_value(values, "command_delay", robot.command_delay_s),
        effects=tuple(spec for e in robot.effects for spec in _effects(robot, e, values)),
    )


def with_fitted_base(robot: Robot, inertial: InertialFit) -> Robot:
    """A robot with the base parameters of a fit, those that it does not determine as given.

    Parameters
    ----------
    robot : Robot
        As given.
    inertial : InertialFit
        Whether or not it was rejected.

    Returns
    -------
    Robot
    """
    base = inertial.model.base
    count = len(base.names)
    known = np.array(inertial.identifiable[:count])
    given = base.combination @ robot.parameter_vector
    values = np.where(known, inertial.fit.theta[:count], given)
    covariance = inertial.fit.covariance[:count, :count]
    return replace(
        with_base(robot, base, values),
        base_parameters=tuple(
            BaseParameter(name, base.coefficients(i), float(values[i]))
            for i, name in enumerate(base.names)
        ),
        base_covariance=np.where(np.outer(known, known), covariance, 0.0),
    )


def has_definite_mass(robot: Robot) -> bool:
    """Whether the mass matrix is positive definite over the joints' ranges, as for `check_robot`.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    bool
    """
    return least_inertia(robot)[0] > 0.0


def replace_rejected(hydraulic: HydraulicFit | None) -> HydraulicFit | None:
    """The hydraulic fit without its rejected cylinders; None where none is left."""
    if hydraulic is None:
        return None
    kept = tuple(c for c in hydraulic.cylinders if not c.rejected)
    return replace(hydraulic, cylinders=kept) if kept else None


def with_viscous_friction(robot: Robot, values: Mapping[str, float]) -> Robot:
    """A robot with the viscous friction of its cylinders replaced.

    As in the paper's Table IV, a datasheet robot that is to be compared with an identified one
    borrows its friction: no datasheet gives it.

    Parameters
    ----------
    robot : Robot
    values : mapping of str to float
        N s/m by cylinder name.

    Returns
    -------
    Robot
    """
    for name in values:
        robot.cylinder(name)
    cylinders = tuple(
        replace(c, viscous_friction=float(values.get(c.name, c.viscous_friction)))
        for c in robot.cylinders
    )
    return replace(robot, cylinders=cylinders)


def with_edge_coefficient(robot: Robot, coefficient: float) -> Robot:
    """A robot with one coefficient on every edge of every valve.

    Parameters
    ----------
    robot : Robot
    coefficient : float
        m^3/(s sqrt(Pa)). 6.30e-7 is the paper's printed nominal, which divides by the 70 bar
        of two edges in series; 8.91e-7 is the datasheet's 100 l/min at 35 bar per edge.

    Returns
    -------
    Robot
    """
    valves = tuple(
        replace(v, c_pa=coefficient, c_at=coefficient, c_pb=coefficient, c_bt=coefficient)
        for v in robot.valves
    )
    return replace(robot, valves=valves)


def _value(values: Mapping[str, Parameter], name: str, given: float) -> float:
    return values[name].value if name in values else given


def _cylinder(cylinder: Cylinder, values: Mapping[str, Parameter]) -> Cylinder:
    name = cylinder.name
    friction = _value(values, f"{name}.viscous_friction", cylinder.viscous_friction)
    bulk = _value(values, f"{name}.bulk_modulus", cylinder.bulk_modulus_pa)
    return replace(cylinder, viscous_friction=friction, bulk_modulus_pa=bulk)


def _valve(valve: Valve, values: Mapping[str, Parameter]) -> Valve:
    c_pa, c_at, c_pb, c_bt = (
        _value(values, f"{valve.name}.{edge}", float(getattr(valve, edge)))
        for edge in ("c_pa", "c_at", "c_pb", "c_bt")
    )
    return replace(valve, c_pa=c_pa, c_at=c_at, c_pb=c_pb, c_bt=c_bt)


def _effects(
    robot: Robot, effect: EffectSpec, values: Mapping[str, Parameter]
) -> list[EffectSpec]:
    """An effect with fitted parameters, once per owner where it was listed for all."""
    owners = {
        c.name: [c.name, c.joint, *(v.name for v in robot.valves if v.cylinder == c.name)]
        for c in robot.cylinders
    }
    owners |= {robot.joint_names[j]: [robot.joint_names[j]] for j in robot.dry_joints}
    # What all of a robot has from one cause has one set of numbers.
    owners[robot.name] = [robot.name]
    fitted = {}
    for owner, targets in owners.items():
        if effect.target in (robot.name, *targets):
            prefix = f"{owner}.{effect.name}."
            found = {
                n.removeprefix(prefix): p.value for n, p in values.items() if n.startswith(prefix)
            }
            if found:
                fitted[owner] = found
    if not fitted:
        return [effect]
    specs = [
        EffectSpec(effect.name, name, {**effect.parameters, **found})
        for name, found in fitted.items()
    ]
    if robot.name in fitted:
        return specs
    # Where it was listed for several and not fitted at one, it stays there as given.
    taken = {target for owner in fitted for target in (owner, *owners[owner])}
    acting = [one.target for one in resolve(replace(robot, effects=(effect,)))]
    return specs + [replace(effect, target=target) for target in acting if target not in taken]
