"""What changed since an earlier identification of the same machine, and how surely.

The change of a parameter is judged against the standard deviations of both identifications:
``z = (new - old) / sqrt(s_new^2 + s_old^2)``, with a two-sided normal p-value. Many parameters
are tested at once, so a change is called one by the p-value adjusted by Holm (Scandinavian
Journal of Statistics 6, 1979), which keeps the chance of any false alarm at the level. The base
parameters are also tested together (Wald), with both covariances, since their errors go hand in
hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.parameters import Parameter
from hydro_model.robot import FloatArray, Robot

#: Chance of calling anything changed where nothing is.
LEVEL = 0.05
#: Coefficients of a combination that agree to this are the same.
_SAME = 1e-6


@dataclass(frozen=True, slots=True)
class Change:
    """The change of one parameter.

    Attributes
    ----------
    name, unit : str
    old, new : float
    std : float or None
        Of the difference; None where neither side gives one.
    old_known : bool
        The old model gives a standard deviation.
    z, p_value, p_adjusted : float or None
        Adjusted for all parameters tested.
    changed : bool
        `p_adjusted` below `LEVEL`.
    """

    name: str
    unit: str
    old: float
    new: float
    std: float | None
    old_known: bool
    z: float | None
    p_value: float | None
    p_adjusted: float | None = None
    changed: bool = False


@dataclass(frozen=True, slots=True)
class JointTest:
    """Wald test of the base parameters together that both identifications determined.

    Attributes
    ----------
    statistic : float
        Chi-squared.
    freedom : int
    p_value : float
    """

    statistic: float
    freedom: int
    p_value: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """An identification against an earlier model.

    Attributes
    ----------
    old : str
        The earlier model, as given.
    changes : tuple of Change
    base : JointTest or None
        None where either model gives no covariance.
    notes : tuple of str
    """

    old: str
    changes: tuple[Change, ...]
    base: JointTest | None
    notes: tuple[str, ...]


def compare(old: Robot, new: Robot, parameters: Sequence[Parameter], label: str) -> Comparison:
    """Compare an identification with an earlier model.

    Parameters
    ----------
    old : Robot
        The earlier model.
    new : Robot
        The identified robot.
    parameters : sequence of Parameter
        Of the identification; those not identifiable are left out.
    label : str
        The earlier model, as given.

    Returns
    -------
    Comparison

    Raises
    ------
    IdentError
        The earlier model is of another machine.
    """
    check_same_machine(old, new, label, parameters)
    notes: list[str] = []
    changes = []
    for p in parameters:
        if not p.identifiable:
            notes.append(f"{p.name}: not identified this time, not compared")
            continue
        before = old_value(old, p)
        if before is None:
            notes.append(f"{p.name}: not in {label}, not compared")
            continue
        changes.append(_change(p, before, old_deviation(old, p)))
    if any(not change.old_known for change in changes):
        notes.append(
            f"{label} gives no standard deviation for some parameters: their significance counts"
            " this identification's alone"
        )
    return Comparison(label, _adjusted(changes), _base_test(old, new), tuple(notes))


def old_value(robot: Robot, parameter: Parameter) -> float | None:
    """Value of an identified parameter in another model; None where that has none."""
    if parameter.combination:
        values = _inertia(robot)
        return float(sum(c * values[name] for name, c in parameter.combination.items()))
    owner, _, rest = parameter.name.partition(".")
    if not rest:
        return robot.command_delay_s
    if "." in rest:
        effect, name = rest.split(".", 1)
        return _listed(robot, owner, effect, name)
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
        transfer = _transfer(robot, [parameter.combination])
        if transfer is not None and robot.base_covariance is not None:
            variance = float((transfer @ robot.base_covariance @ transfer.T)[0, 0])
            # Zero stands for a parameter that was not identified and kept the robot file's value.
            return math.sqrt(variance) if variance > 0.0 else None
    return robot.standard_deviations.get(parameter.name)


def _listed(robot: Robot, owner: str, effect: str, name: str) -> float | None:
    targets = [owner, robot.name, *(v.name for v in robot.valves if v.cylinder == owner)]
    targets += [c.joint for c in robot.cylinders if c.name == owner]
    for spec in robot.effects:
        if spec.name == effect and spec.target in targets and name in spec.parameters:
            return float(spec.parameters[name])
    return None


def _inertia(robot: Robot) -> dict[str, float]:
    return dict(zip(robot.parameter_names, map(float, robot.parameter_vector), strict=True))


def _transfer(old: Robot, combinations: Sequence[Mapping[str, float]]) -> FloatArray | None:
    """Combinations in terms of the old model's base parameters, (k, p)."""
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


def _change(p: Parameter, before: float, deviation: float | None) -> Change:
    new_std = p.std if math.isfinite(p.std) else None
    known = [s for s in (new_std, deviation) if s is not None]
    std = math.hypot(*known) if known else None
    z = (p.value - before) / std if std else None
    chance = None if z is None else math.erfc(abs(z) / math.sqrt(2.0))
    return Change(p.name, p.unit, before, p.value, std, deviation is not None, z, chance)


def _adjusted(changes: Sequence[Change]) -> tuple[Change, ...]:
    """P-values adjusted by Holm's step-down."""
    tested = sorted((c.p_value, i) for i, c in enumerate(changes) if c.p_value is not None)
    result, worst = list(changes), 0.0
    for rank, (chance, i) in enumerate(tested):
        worst = max(worst, min(1.0, chance * (len(tested) - rank)))
        result[i] = replace(changes[i], p_adjusted=worst, changed=worst < LEVEL)
    return tuple(result)


def _base_test(old: Robot, new: Robot) -> JointTest | None:
    from scipy.stats import chi2

    rows = new.base_parameters
    transfer = _transfer(old, [p.combination for p in rows])
    if transfer is None or old.base_covariance is None or new.base_covariance is None:
        return None
    values = _inertia(old)
    before = [sum(c * values[n] for n, c in p.combination.items()) for p in rows]
    difference = np.array([p.value for p in rows]) - np.array(before)
    earlier = transfer @ old.base_covariance @ transfer.T
    # Zero variance stands for what was not identified and kept the robot file's value.
    known = (np.diag(new.base_covariance) > 0.0) & (np.diag(earlier) > 0.0)
    if not known.any():
        return None
    covariance = (new.base_covariance + earlier)[np.ix_(known, known)]
    difference = difference[known]
    scale = np.sqrt(np.diag(covariance))
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    unit = difference / scale
    statistic = float(unit @ inverse @ unit)
    freedom = int(np.linalg.matrix_rank(inverse, hermitian=True))
    return JointTest(statistic, freedom, float(chi2.sf(statistic, freedom)))
