"""The identified parameters as rows of the result file and of `/base_parameters`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from hydro_ident.estimate.chambers import INVERSE_BULK
from hydro_ident.estimate.hydraulics import CylinderFit, HydraulicFit
from hydro_ident.estimate.inertial import InertialFit
from hydro_ident.estimate.listed_effects import OVER_BULK
from hydro_model.robot import STANDARD_PARAMETERS, STANDARD_UNITS, Robot

#: Half width of a 95 % interval in standard deviations of a normal distribution.
NORMAL_95 = 1.959963984540054
_EDGE_UNIT = "m^3/(s sqrt(Pa))"


@dataclass(frozen=True, slots=True)
class Parameter:
    """An identified parameter.

    Attributes
    ----------
    name : str
    value, std : float
    unit : str
    datasheet : float or None
        The given robot's value, where it has one.
    identifiable : bool
    combination : mapping of str to float
        Of a base parameter: coefficients over standard parameters.
    """

    name: str
    value: float
    std: float
    unit: str
    datasheet: float | None
    identifiable: bool
    combination: Mapping[str, float] = field(default_factory=dict)

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % confidence interval."""
        return self.value - NORMAL_95 * self.std, self.value + NORMAL_95 * self.std


def parameter_list(
    robot: Robot,
    inertial: InertialFit | None,
    hydraulic: HydraulicFit | None,
    biases: Mapping[str, float] | None = None,
) -> tuple[Parameter, ...]:
    """Every parameter that was fitted, identifiable or not.

    Parameters
    ----------
    robot : Robot
        For the datasheet column.
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    biases : mapping of str to float, optional
        Fitted null biases, whose last steps `hydraulic` holds.

    Returns
    -------
    tuple of Parameter
        Base parameters, friction, then per cylinder bulk modulus and edges, then the delay.
    """
    found = _inertial_parameters(robot, inertial) if inertial is not None else []
    if hydraulic is not None:
        for fit in hydraulic.cylinders:
            found += _cylinder_parameters(robot, fit, biases or {})
        known = math.isfinite(hydraulic.delay_std_s)
        found.append(
            Parameter(
                "command_delay",
                hydraulic.delay_s,
                hydraulic.delay_std_s if known else 0.0,
                "s",
                robot.command_delay_s,
                known,
            )
        )
    return tuple(found)


def _inertial_parameters(robot: Robot, inertial: InertialFit) -> list[Parameter]:
    base = inertial.model.base
    units = dict(zip(STANDARD_PARAMETERS, STANDARD_UNITS, strict=True))
    given = base.combination @ robot.link_inertia.ravel()
    friction = {f"{c.name}.viscous_friction": c.viscous_friction for c in robot.cylinders}
    found = []
    rows = zip(
        inertial.model.names,
        inertial.fit.theta,
        inertial.fit.std,
        inertial.identifiable,
        strict=True,
    )
    for i, (name, value, std, known) in enumerate(rows):
        unit, datasheet, combination = "", None, {}
        if i < len(base.names):
            unit, datasheet = units[name.rsplit(".", 1)[-1]], float(given[i])
            combination = base.coefficients(i)
        elif name in friction:
            unit, datasheet = "N s/m", friction[name] or None
        else:
            unit, datasheet = effect_unit(name), listed_value(robot, name)
        found.append(
            Parameter(name, float(value), float(std), unit, datasheet, known, combination)
        )
    return found


def _cylinder_parameters(
    robot: Robot, fit: CylinderFit, biases: Mapping[str, float]
) -> list[Parameter]:
    valve = robot.valve_of(fit.cylinder)
    # A rejected stage is shown, and nothing of it is used.
    usable = [known and not fit.rejected for known in fit.identifiable]
    good = dict(zip(fit.names, usable, strict=True))
    inverse, inverse_std = fit.value(INVERSE_BULK)
    bulk, bulk_std = fit.bulk_modulus() if inverse != 0.0 else (0.0, 0.0)
    found = [
        Parameter(
            f"{fit.cylinder}.bulk_modulus",
            bulk,
            bulk_std,
            "Pa",
            robot.cylinder(fit.cylinder).bulk_modulus_pa,
            good[INVERSE_BULK],
        )
    ]
    for name in fit.names:
        value, std = fit.value(name)
        if name == INVERSE_BULK:
            continue
        if name.startswith("c_"):
            datasheet = float(getattr(valve, name))
            full, unit = f"{fit.valve}.{name}", _EDGE_UNIT
        else:
            full, unit = f"{fit.cylinder}.{name.removesuffix(OVER_BULK)}", effect_unit(name)
            datasheet = listed_value(robot, full)
            value = biases.get(full, value)
            if name.endswith(OVER_BULK):
                value, std = (
                    value / inverse,
                    math.hypot(std, value * inverse_std / inverse) / inverse,
                )
        found.append(Parameter(full, value, abs(std), unit, datasheet, good[name]))
    return found


def effect_unit(name: str) -> str:
    """Unit of `[<cylinder>.]<effect>.<parameter>` from the catalogue."""
    from hydro_model.effects.catalogue import CATALOGUE

    effect, parameter = name.removesuffix(OVER_BULK).split(".")[-2:]
    return next(p.unit for p in CATALOGUE[effect].parameters if p.name == parameter)


def listed_value(robot: Robot, name: str) -> float:
    """Value that the robot lists for `<cylinder>.<effect>.<parameter>`; 0 where it lists none."""
    cylinder, effect, parameter = name.split(".")
    joint = robot.cylinder(cylinder).joint
    valves = [v.name for v in robot.valves if v.cylinder == cylinder]
    for spec in robot.effects:
        if spec.name == effect and spec.target in (cylinder, joint, robot.name, *valves):
            return float(spec.parameters.get(parameter, 0.0))
    return 0.0
