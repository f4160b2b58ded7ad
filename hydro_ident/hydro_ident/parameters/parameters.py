"""The identified parameters as rows of the result file and of `/base_parameters`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from hydro_ident.estimate.flows.chambers import INVERSE_BULK, OVER_BULK
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.parameters.parameter_names import parts_of
from hydro_ident.robots.robot_numbers import BULK_BOUNDS_PA
from hydro_model.effects.units import effect_units, unit_at_joint
from hydro_model.robot import STANDARD_PARAMETERS, STANDARD_UNITS, FloatArray, Robot

#: Half width of a 95 % interval in standard deviations of a normal distribution.
NORMAL_95 = 1.959963984540054
COMMAND_DELAY = "command_delay"
_EDGE_UNIT = "m^3/(s sqrt(Pa))"


@dataclass(frozen=True, slots=True)
class Parameter:
    """An identified parameter.

    Attributes
    ----------
    name : str
    value, std : float
        The deviation is infinite where the data say nothing of the value: `untold`.
    unit : str
    datasheet : float or None
        The given robot's value, where it has one.
    identifiable : bool
    combination : mapping of str to float
        Of a base parameter: coefficients over standard parameters.
    reason : str
        Why it was held or rejected, where it was; of the delay, that it is at its bound.
    dof : float
        Degrees of freedom of `std`, which a finite recording knows to some percent only.
    held : bool
        Not fitted: at the given value or at a bound. `std` says nothing then.
    model_error : bool
        Physics is left out in its channels: it may be off by more than `std` says.
    bounds : pair of float
        Range that the value cannot leave; the interval ends there.
    reciprocal : bool
        What is fitted, and what errs as normal noise does, is 1 / value: `std` is to first order,
        and the interval's ends are those of 1 / value.
    """

    name: str
    value: float
    std: float
    unit: str
    datasheet: float | None
    identifiable: bool
    combination: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    dof: float = math.inf
    held: bool = False
    model_error: bool = False
    bounds: tuple[float, float] = (-math.inf, math.inf)
    reciprocal: bool = False

    @property
    def untold(self) -> bool:
        """Whether there is no deviation to state: the value was held, or no data bear on it."""
        return self.held or not math.isfinite(self.std)

    @property
    def ci95(self) -> tuple[float, float] | None:
        """95 % confidence interval, by Student's quantile; None where the value is `untold`."""
        if self.untold:
            return None
        half = student_95(self.dof) * self.std
        low, high = self.value - half, self.value + half
        if self.reciprocal and self.value > 0.0:
            share = half / self.value
            low = self.value / (1.0 + share)
            high = self.value / (1.0 - share) if share < 1.0 else math.inf
        if not self.bounds[0] <= self.value <= self.bounds[1]:
            return low, high
        return max(low, self.bounds[0]), min(high, self.bounds[1])


def student_95(dof: float) -> float:
    """Half width of a 95 % interval in standard deviations."""
    if not math.isfinite(dof):
        return NORMAL_95
    from scipy.special import stdtrit

    return float(stdtrit(dof, 0.975))


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
            found += cylinder_parameters(robot, fit, biases or {})
        found.append(_delay(robot, hydraulic))
    return tuple(found)


def _delay(robot: Robot, hydraulic: HydraulicFit) -> Parameter:
    known, value = math.isfinite(hydraulic.delay_std_s), hydraulic.delay_s
    used = any(not c.rejected for c in hydraulic.cylinders)
    reason, longest = "", 0.0 < hydraulic.longest_s <= value
    if not used:
        reason = "hydraulics rejected: those of every cylinder"
    elif not known and hydraulic.by_spools:
        reason = "no voltage tells it: the openings are measured spools"
    elif known and longest:
        cycles = hydraulic.windows.max_delay_cycles
        tried = f"{cycles:g} cycles, {value:g} s" if cycles > 1.0 else f"one cycle of {value:g} s"
        reason = (
            f"at its longest, {tried}: something else lags, too (a spool?);"
            " its interval is one-sided"
        )
    elif known and value <= 0.0 < hydraulic.longest_s:
        reason = "at its bound 0 s: its interval is one-sided"
    return Parameter(
        COMMAND_DELAY,
        value,
        hydraulic.delay_std_s,
        "s",
        robot.command_delay_s,
        known and used,
        reason=reason,
        dof=hydraulic.delay_dof,
        model_error=known and longest,
        bounds=(0.0, hydraulic.longest_s),
    )


def _inertial_parameters(robot: Robot, inertial: InertialFit) -> list[Parameter]:
    base = inertial.model.base
    units = dict(zip(STANDARD_PARAMETERS, STANDARD_UNITS, strict=True))
    given = base.combination @ robot.parameter_vector
    friction = {f"{c.name}.viscous_friction": c.viscous_friction for c in robot.cylinders}
    dry = [robot.joints[j] for j in robot.dry_joints]
    friction |= {f"{j.name}.viscous_friction": j.viscous_friction for j in dry}
    reasons = {part.index: part.reason for part in inertial.held}
    rejected = f"forces rejected: {inertial.rejected}" if inertial.rejected else ""
    found = []
    dof = _known_dof(inertial.fit.dof, len(inertial.model.names))
    rows = zip(
        inertial.model.names,
        inertial.fit.theta,
        inertial.fit.std,
        inertial.fit.collinearity,
        inertial.identifiable,
        strict=True,
    )
    for i, (name, value, std, collinear, known) in enumerate(rows):
        unit, datasheet, combination = "", None, {}
        if i < len(base.names):
            unit, datasheet = units[name.rsplit(".", 1)[-1]], float(given[i])
            combination = base.coefficients(i)
        elif name in friction:
            unit, datasheet = viscous_unit(robot, name), friction[name] or None
        else:
            unit, datasheet = effect_unit(robot, name), listed_value(robot, name)
        # A rejected stage is shown, and nothing of it is used.
        used = known and not rejected
        std = _stated(float(std), known, math.isfinite(collinear))
        row = Parameter(name, float(value), std, unit, datasheet, used, combination)
        # What a rejected stage holds at a bound is not used either; barrels and rods stay given.
        held = i in reasons and not (rejected and i >= len(base.names))
        reason = reasons[i] if held else rejected
        found.append(replace(row, reason=reason, dof=dof[i], held=held))
    return found


def _stated(std: float, known: bool, apart: bool = True) -> float:
    """A deviation, infinite where a fit has no errors of a column that says nothing.

    Of columns that are zero, or not `apart` from the others, least squares takes the shortest of
    all solutions: its errors are not those of the parameter.
    """
    return std if known or (apart and std > 0.0) else math.inf


def _apart(fit: CylinderFit, name: str) -> bool:
    """Whether a chamber tells a parameter's column from the others at all."""
    own = [c.fit.collinearity[c.names.index(name)] for c in fit.chambers if name in c.names]
    return min(own, default=0.0) < math.inf


def cylinder_parameters(
    robot: Robot, fit: CylinderFit, biases: Mapping[str, float]
) -> list[Parameter]:
    """Bulk modulus, edges and listed effects of one cylinder.

    Parameters
    ----------
    robot : Robot
    fit : CylinderFit
    biases : mapping of str to float
        Fitted null biases.
    """
    valve = robot.valve_of(fit.cylinder)
    # A rejected stage is shown, and nothing of it is used.
    usable = [known and not fit.rejected for known in fit.identifiable]
    good = dict(zip(fit.names, usable, strict=True))
    dof = dict(zip(fit.names, _known_dof(fit.dof, len(fit.names)), strict=True))
    held = {fit.names[part.index]: part for part in fit.held}
    inverse, inverse_std = fit.value(INVERSE_BULK)
    found = [_bulk_modulus(robot, fit, good[INVERSE_BULK], dof[INVERSE_BULK])]
    for name in fit.names:
        if name == INVERSE_BULK:
            continue
        value, std = fit.value(name)
        std = _stated(std, fit.identifiable[fit.names.index(name)], _apart(fit, name))
        if name.startswith("c_"):
            datasheet = float(getattr(valve, name))
            full, unit = f"{fit.valve}.{name}", _EDGE_UNIT
        else:
            full, unit = f"{fit.cylinder}.{name.removesuffix(OVER_BULK)}", effect_unit(robot, name)
            datasheet = listed_value(robot, full)
            value = biases.get(full, value)
            if name.endswith(OVER_BULK):
                value, std = _over(value, std, inverse, inverse_std)
        found.append(Parameter(full, value, abs(std), unit, datasheet, good[name], dof=dof[name]))
        if name in held:
            found[-1] = replace(
                found[-1], value=held[name].value, reason=held[name].reason, held=True
            )
    rejected = f"hydraulics rejected: {fit.rejected}" if fit.rejected else ""
    return [p if p.held else replace(p, reason=rejected or p.reason) for p in found]


def _over(value: float, std: float, inverse: float, inverse_std: float) -> tuple[float, float]:
    """What was fitted over the bulk modulus, and its deviation; nothing where that is not told."""
    if inverse == 0.0:
        return 0.0, math.inf
    return value / inverse, math.hypot(std, value * inverse_std / inverse) / inverse


def _bulk_modulus(robot: Robot, fit: CylinderFit, good: bool, dof: float) -> Parameter:
    """The bulk modulus as it was fitted, also where the given one is used in its place."""
    (inverse, std), refused, reason = fit.value(INVERSE_BULK), fit.refused_bulk, ""
    if refused is not None:
        inverse, std = refused.inverse, refused.std
        reason = f"rejected, the robot file's kept: {refused.reason}"
    return Parameter(
        f"{fit.cylinder}.bulk_modulus",
        1.0 / inverse if inverse != 0.0 else 0.0,
        _stated(std / inverse**2, good) if inverse != 0.0 else math.inf,
        "Pa",
        robot.cylinder(fit.cylinder).bulk_modulus_pa,
        good,
        reason=reason,
        dof=dof,
        bounds=BULK_BOUNDS_PA,
        reciprocal=True,
    )


def _known_dof(dof: FloatArray, count: int) -> list[float]:
    """Degrees of freedom, infinite where a fit does not say."""
    return [float(d) for d in dof] if dof.size else [math.inf] * count


def viscous_unit(robot: Robot, name: str) -> str:
    """Unit of `<owner>.viscous_friction`, the owner a cylinder or a joint without one."""
    prismatic = _slides(robot, name)
    return "N s/m" if prismatic is None else unit_at_joint("N s/m", prismatic)


def effect_unit(robot: Robot, name: str) -> str:
    """Unit of `[<owner>.]<effect>.<parameter>` from the catalogue, as it is at its owner."""
    from hydro_model.effects.catalogue import CATALOGUE

    effect, parameter = name.removesuffix(OVER_BULK).split(".")[-2:]
    prismatic = _slides(robot, name)
    return next(
        unit
        for form in CATALOGUE[effect].forms
        for spec, unit in zip(form.parameters, effect_units(form, prismatic), strict=True)
        if spec.name == parameter
    )


def _slides(robot: Robot, name: str) -> bool | None:
    """Whether the joint slides that a name begins with; None of all others."""
    owner = parts_of(name)[0]
    dry = (robot.joints[j] for j in robot.dry_joints)
    return next((j.prismatic for j in dry if j.name == owner), None)


def listed_value(robot: Robot, name: str) -> float:
    """Value that the robot lists for `<owner>.<effect>.<parameter>`; 0 where it lists none.

    The owner is a cylinder, or a joint without cylinder.
    """
    return listed_or_none(robot, name) or 0.0


def listed_or_none(robot: Robot, name: str) -> float | None:
    """The same; None where it lists none."""
    owner, effect, parameter = parts_of(name)
    targets = [owner, robot.name, *(v.name for v in robot.valves if v.cylinder == owner)]
    targets += [c.joint for c in robot.cylinders if c.name == owner]
    for spec in robot.effects:
        if spec.name == effect and spec.target in targets and parameter in spec.parameters:
            return float(spec.parameters[parameter])
    return None
