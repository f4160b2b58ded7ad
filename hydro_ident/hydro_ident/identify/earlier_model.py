"""An earlier model of a machine: its values of the parameters that are identified today."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.parameters.parameter_names import parts_of
from hydro_ident.parameters.parameters import Parameter, listed_or_none
from hydro_model.robot import Cylinder, FloatArray, Robot

#: Coefficients of a combination that agree to this are the same; those of cylinders' bodies, by
#: how far the pins are apart, as well: they are lengths and sines of pins' angles.
_SAME, _BY_PINS = 1e-6, 3.0
#: Share of an area, a lever or a volume, and the angle in rad by which calibrations of one machine
#: differ: less than what is identified is known to.
_SHARE, _ANGLE_RAD = 1e-4, 1e-3


def old_value(robot: Robot, parameter: Parameter) -> float | None:
    """Value of an identified parameter in another model; None where that has none."""
    if parameter.combination:
        values = inertia(robot)
        return float(sum(c * values[name] for name, c in parameter.combination.items()))
    owner, effect, rest = parts_of(parameter.name)
    if not owner:
        return robot.command_delay_s
    if effect:
        return listed_or_none(robot, parameter.name)
    for cylinder in robot.cylinders:
        if cylinder.name == owner:
            bulk = rest == "bulk_modulus"
            return cylinder.bulk_modulus_pa if bulk else cylinder.viscous_friction
    for valve in robot.valves:
        if valve.name == owner:
            return float(getattr(valve, rest))
    for joint in robot.joints:
        if joint.name == owner:
            return joint.viscous_friction
    return None


def old_deviation(robot: Robot, parameter: Parameter) -> float | None:
    """Standard deviation of an identified parameter in another model; None where unknown."""
    if parameter.combination:
        transfer = transfer_from(robot, [parameter.combination])
        if transfer is not None and robot.base_covariance is not None:
            variance = float((transfer @ robot.base_covariance @ transfer.T)[0, 0])
            # Zero stands for a parameter that was not identified and kept the robot file's value.
            return math.sqrt(variance) if variance > 0.0 else None
    return robot.standard_deviations.get(parameter.name)


def inertia(robot: Robot) -> dict[str, float]:
    """All standard parameters by name."""
    return dict(zip(robot.parameter_names, map(float, robot.parameter_vector), strict=True))


def transfer_from(old: Robot, combinations: Sequence[Mapping[str, float]]) -> FloatArray | None:
    """Combinations by an old model's base parameters, (k, p); None where it has none."""
    if not old.base_parameters:
        return None
    leading = [p.name for p in old.base_parameters]
    return np.array([[row.get(name, 0.0) for name in leading] for row in combinations])


def check_same_machine(
    old: Robot, new: Robot, label: str, parameters: Sequence[Parameter] = ()
) -> list[str]:
    """Refuse to compare what is not comparable.

    Parameters
    ----------
    old, new : Robot
    label : str
        The earlier model, as given.
    parameters : sequence of Parameter
        Whose combinations have to be those of the earlier model.

    Returns
    -------
    list of str
        Of geometries that are nearly the same: what differs.

    Raises
    ------
    IdentError
        Other joints or cylinders, or another geometry.
    """
    for what, ours, theirs in (
        ("joints", new.joint_names, old.joint_names),
        ("cylinders", [c.name for c in new.cylinders], [c.name for c in old.cylinders]),
    ):
        if list(ours) != list(theirs):
            raise IdentError(
                f"{label}: expected a model of the same machine with {what} {', '.join(ours)},"
                f" found {', '.join(theirs) or 'none'}"
            )
    gaps = [_gaps(a, b) for a, b in zip(new.cylinders, old.cylinders, strict=True)]
    for own, found in zip(new.cylinders, gaps, strict=True):
        if other := [gap.text for gap in found if gap.size > gap.allowed]:
            raise IdentError(
                f"{label}: expected the geometry of the same machine, found {own.name} with"
                f" {'; '.join(other)}: forces and flows count by it, so that their numbers cannot"
                " be compared"
            )
    pins = max((gap.size for found in gaps for gap in found), default=0.0)
    _check_combinations(old, parameters, label, _SAME + _BY_PINS * pins)
    return [
        f"{own.name}: {gap.text} ({label}): near enough to be compared, numbers may differ by it"
        for own, found in zip(new.cylinders, gaps, strict=True)
        for gap in found
        if gap.size > _SAME
    ]


def _check_combinations(
    old: Robot, parameters: Sequence[Parameter], label: str, same: float
) -> None:
    """Refuse base parameters that are other combinations in the earlier model."""
    known = {p.name: p.combination for p in old.base_parameters}
    for p in parameters:
        before = known.get(p.name, p.combination)
        names = {*before, *p.combination}
        gaps = [abs(before.get(n, 0.0) - p.combination.get(n, 0.0)) for n in names]
        if max(gaps, default=0.0) > same:
            raise IdentError(
                f"{label}: base parameter {p.name} is another combination there: the geometry of"
                " the two robot files differs, so that their numbers cannot be compared"
            )


@dataclass(frozen=True, slots=True)
class _Gap:
    """A number of a cylinder's geometry that differs: by how much, and what is let pass."""

    size: float
    allowed: float
    text: str


def _gaps(new: Cylinder, old: Cylinder) -> list[_Gap]:
    """What of a cylinder's geometry differs, against what its effect lets pass.

    Areas go by the diameters' squares, levers by the pins' distances, volumes by the stroke.
    """
    stroke = _SHARE * new.stroke_m
    allowed = {
        "bore_m": 0.5 * _SHARE * new.bore_m,
        # The annulus is what is left of the bore's area.
        "rod_m": 2.0 / math.pi * _SHARE * new.area_b_m2 / new.rod_m if new.rod_m else 0.0,
        "stroke_m": stroke,
        "l1_m": _SHARE * new.l1_m,
        "l2_m": _SHARE * new.l2_m,
        "q0_rad": _ANGLE_RAD,
        "x0_m": stroke,
    }
    # The pin's own direction moves bodies alone.
    if any(part is not None for c in (new, old) for part in (c.barrel, c.rod)):
        allowed["child_pin_angle_rad"] = _ANGLE_RAD
    pairs = {name: (getattr(new, name), getattr(old, name)) for name in allowed}
    return [
        _Gap(abs(a - b), allowed[name], f"{name} {a:.9g}, {b:.9g} there")
        for name, (a, b) in pairs.items()
        if a != b
    ]
