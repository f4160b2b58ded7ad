"""An earlier model of a machine: its values of the parameters that are identified today."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.parameters.parameter_names import parts_of
from hydro_ident.parameters.parameters import Parameter, listed_or_none
from hydro_model.robot import FloatArray, Robot

#: Coefficients of a combination that agree to this are the same.
_SAME = 1e-6
#: Of a cylinder: its areas, its stroke and its triangle, m and rad.
_GEOMETRY = ("bore_m", "rod_m", "stroke_m", "l1_m", "l2_m", "q0_rad", "x0_m")


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
) -> None:
    """Refuse to compare what is not comparable.

    Parameters
    ----------
    old, new : Robot
    label : str
        The earlier model, as given.
    parameters : sequence of Parameter
        Whose combinations have to be those of the earlier model.

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
    for own, earlier in zip(new.cylinders, old.cylinders, strict=True):
        other = [
            f"{field} {getattr(own, field):.6g}, {getattr(earlier, field):.6g} there"
            for field in _GEOMETRY
            if abs(getattr(own, field) - getattr(earlier, field)) > _SAME
        ]
        if other:
            raise IdentError(
                f"{label}: expected the geometry of the same machine, found {own.name} with"
                f" {'; '.join(other)}: forces and flows count by it, so that their numbers cannot"
                " be compared"
            )
    known = {p.name: p.combination for p in old.base_parameters}
    for p in parameters:
        before = known.get(p.name, p.combination)
        names = {*before, *p.combination}
        gaps = [abs(before.get(n, 0.0) - p.combination.get(n, 0.0)) for n in names]
        if max(gaps, default=0.0) > _SAME:
            raise IdentError(
                f"{label}: base parameter {p.name} is another combination there: the geometry of"
                " the two robot files differs, so that their numbers cannot be compared"
            )
