"""A robot with identified numbers in the place of the given ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.hydraulics import HydraulicFit
from hydro_ident.estimate.inertial import InertialFit
from hydro_ident.parameters import Parameter, parameter_list
from hydro_model.robot import (
    STANDARD_PARAMETERS,
    BaseParameter,
    Cylinder,
    EffectSpec,
    Robot,
    Valve,
)


def identified_robot(
    robot: Robot,
    inertial: InertialFit,
    hydraulic: HydraulicFit | None,
    biases: Mapping[str, float] | None = None,
) -> Robot:
    """Put what was identified into a robot; what was rejected stays as given.

    Parameters
    ----------
    robot : Robot
    inertial : InertialFit
        With every base parameter identifiable.
    hydraulic : HydraulicFit or None
    biases : mapping of str to float, optional
        Fitted null biases of the valves.

    Returns
    -------
    Robot
        Its leading standard parameters carry the base parameters, the others are zero.
    """
    accepted = replace_rejected(hydraulic)
    found = parameter_list(robot, inertial, accepted, biases)
    values = {p.name: p for p in found if p.identifiable}
    base = inertial.model.base
    count = len(base.names)
    theta = np.zeros(len(robot.standard_names))
    theta[base.leading] = inertial.fit.theta[:count]
    parameters = tuple(
        BaseParameter(name, base.coefficients(i), float(inertial.fit.theta[i]))
        for i, name in enumerate(base.names)
    )
    return replace(
        robot,
        link_inertia=theta.reshape(-1, len(STANDARD_PARAMETERS)),
        base_parameters=parameters,
        base_covariance=inertial.fit.covariance[:count, :count],
        cylinders=tuple(_cylinder(c, values) for c in robot.cylinders),
        valves=tuple(_valve(v, values) for v in robot.valves),
        command_delay_s=_value(values, "command_delay", robot.command_delay_s),
        effects=tuple(spec for e in robot.effects for spec in _effects(robot, e, values)),
    )


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
    """An effect with fitted parameters, once per cylinder where it was listed for all."""
    fitted = {}
    for cylinder in robot.cylinders:
        valves = [v.name for v in robot.valves if v.cylinder == cylinder.name]
        if effect.target in (cylinder.name, cylinder.joint, robot.name, *valves):
            prefix = f"{cylinder.name}.{effect.name}."
            found = {n.removeprefix(prefix): p.value for n, p in values.items() if prefix in n}
            if found:
                fitted[cylinder.name] = found
    if not fitted:
        return [effect]
    return [
        EffectSpec(effect.name, name, {**effect.parameters, **found})
        for name, found in fitted.items()
    ]
