"""What changed since an earlier identification of the same machine, and how surely.

The change of a parameter is judged against the deviations of both identifications, those of noise
s and those that physics left out may make m (`hydro_ident.estimate.effects.left_out`):

    t = (new - old) / sqrt(s_new^2 + s_old^2 + m_new^2 + m_old^2)

with a two-sided p-value of Student's distribution, its degrees of freedom by Welch (Biometrika 34,
1947). The base parameters are also tested together (Wald), with both covariances, since their
errors go hand in hand. Many things are tested at once, so a change is called one by the p-value
adjusted by Holm (Scandinavian Journal of Statistics 6, 1979), which keeps the chance of any false
alarm at the level. What noise alone would not explain and left-out physics would is called not
conclusive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.identify.earlier_model import (
    check_same_machine,
    old_deviation,
    old_value,
    transfer_from,
)
from hydro_ident.identify.significance import (
    CHANGED,
    LEVEL,
    NOT_CONCLUSIVE,
    UNCHANGED,
    Significance,
    f_tail,
    holm,
    two_sided,
    wald,
    welch_dof,
)
from hydro_ident.parameters.model_statistics import Statistics, shared_bags
from hydro_ident.parameters.parameters import Parameter
from hydro_model.robot import Robot

__all__ = [
    "CHANGED",
    "LEVEL",
    "NOT_CONCLUSIVE",
    "UNCHANGED",
    "Change",
    "Comparison",
    "JointTest",
    "Sides",
    "compare",
]


@dataclass(frozen=True, slots=True)
class Change:
    """The change of one parameter.

    Attributes
    ----------
    name, unit : str
    old, new : float
    std : float or None
        Of the difference, for noise; None where neither side gives one.
    model_error : float
        The same for physics left out of the model.
    dof : float
        Degrees of freedom of the two together.
    old_known : bool
        The old model gives a standard deviation.
    test : Significance or None
        None where no standard deviation is known.
    """

    name: str
    unit: str
    old: float
    new: float
    std: float | None
    model_error: float
    dof: float
    old_known: bool
    test: Significance | None

    @property
    def z(self) -> float | None:
        """Change in standard deviations of both kinds."""
        spread = math.hypot(self.std or 0.0, self.model_error)
        return (self.new - self.old) / spread if self.test is not None else None

    @property
    def changed(self) -> bool:
        """Whether it surely changed."""
        return self.test is not None and self.test.outcome == CHANGED


@dataclass(frozen=True, slots=True)
class JointTest:
    """Wald test of the base parameters together that both identifications determined.

    Attributes
    ----------
    statistic : float
        Chi-squared, were the deviations known exactly.
    freedom : int
    dof : float
        Degrees of freedom of the deviations: `statistic / freedom` is F's.
    test : Significance
    """

    statistic: float
    freedom: int
    dof: float
    test: Significance


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


@dataclass(frozen=True, slots=True)
class Sides:
    """Statistics of the two identifications.

    Attributes
    ----------
    old, new : Statistics
    """

    old: Statistics = field(default_factory=Statistics)
    new: Statistics = field(default_factory=Statistics)


def compare(
    old: Robot,
    new: Robot,
    parameters: Sequence[Parameter],
    label: str,
    sides: Sides | None = None,
) -> Comparison:
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
    sides : Sides, optional
        Degrees of freedom and model errors; without them deviations count as exact and the model
        as complete.

    Returns
    -------
    Comparison

    Raises
    ------
    IdentError
        The earlier model is of another machine.
    """
    near = check_same_machine(old, new, label, parameters)
    sides = sides or Sides()
    notes = [*near, *_same_bags(sides, label)]
    changes = []
    # What an identified model gives no deviation for, it has from its own robot file.
    identified = old.base_covariance is not None or bool(old.standard_deviations)
    for p in parameters:
        if not p.identifiable:
            notes.append(f"{p.name}: not identified this time, not compared")
            continue
        before = old_value(old, p)
        if before is None:
            notes.append(f"{p.name}: not in {label}, not compared")
            continue
        deviation = old_deviation(old, p)
        if deviation is None and identified:
            notes.append(f"{p.name}: not identified in {label}, not compared")
            continue
        changes.append(_change(p, before, deviation, sides))
    if any(not change.old_known for change in changes):
        notes.append(
            f"{label} gives no standard deviations: the significance of changes counts this"
            " identification's alone"
        )
    found, base = _adjusted(changes, _base_test(old, new, changes, sides))
    outcomes = [c.test.outcome for c in found if c.test is not None]
    outcomes += [] if base is None else [base.test.outcome]
    if NOT_CONCLUSIVE in outcomes:
        notes.append(
            "not conclusive: more than noise explains, no more than the physics may that the model"
            " leaves out (the residuals are far above the sensors' noise) when the motion differs;"
            " compare recordings of the same motion, or list the effects that are missing"
        )
    return Comparison(label, found, base, tuple(notes))


def _same_bags(sides: Sides, label: str) -> list[str]:
    shared = shared_bags(sides.old, sides.new)
    if not shared:
        return []
    return [
        f"warning: {label} was identified from {', '.join(shared)}, too: the two sides are not"
        " independent, so that changes and their significance mean little; compare other bags"
    ]


def _change(p: Parameter, before: float, deviation: float | None, sides: Sides) -> Change:
    new_std = p.std if math.isfinite(p.std) else None
    known = [s for s in (new_std, deviation) if s is not None]
    std = math.hypot(*known) if known else None
    error = math.hypot(*(side.model_error.get(p.name, 0.0) for side in (sides.new, sides.old)))
    parts = [
        (new_std or 0.0, sides.new.dof.get(p.name, p.dof)),
        (deviation or 0.0, sides.old.dof.get(p.name, math.inf)),
    ]
    dof, test = welch_dof([*parts, (error, math.inf)]), None
    if std:
        step = p.value - before
        test = Significance(
            two_sided(step / math.hypot(std, error), dof),
            two_sided(step / std, welch_dof(parts)),
        )
    return Change(p.name, p.unit, before, p.value, std, error, dof, deviation is not None, test)


def _adjusted(
    changes: Sequence[Change], base: JointTest | None
) -> tuple[tuple[Change, ...], JointTest | None]:
    """P-values adjusted by Holm's step-down, over parameters and the base parameters together."""
    tests = [c.test for c in changes if c.test is not None]
    tests += [] if base is None else [base.test]
    adjusted = iter(
        replace(test, p_adjusted=p, noise_p_adjusted=noise)
        for test, p, noise in zip(
            tests,
            holm([test.p_value for test in tests]),
            holm([test.noise_p_value for test in tests]),
            strict=True,
        )
    )
    found = tuple(c if c.test is None else replace(c, test=next(adjusted)) for c in changes)
    return found, None if base is None else replace(base, test=next(adjusted))


def _base_test(
    old: Robot, new: Robot, changes: Sequence[Change], sides: Sides
) -> JointTest | None:
    compared = {c.name: c for c in changes if c.test is not None}
    rows = new.base_parameters
    transfer = transfer_from(old, [p.combination for p in rows])
    if transfer is None or old.base_covariance is None or new.base_covariance is None:
        return None
    earlier = transfer @ old.base_covariance @ transfer.T
    # Zero variance stands for what was not identified and kept the robot file's value.
    known = (np.diag(new.base_covariance) > 0.0) & (np.diag(earlier) > 0.0)
    known &= np.array([p.name in compared for p in rows], dtype=bool)
    if not known.any():
        return None
    used = [compared[p.name] for p, there in zip(rows, known, strict=True) if there]
    difference = np.array([c.new - c.old for c in used])
    chosen = np.ix_(known, known)
    noise = (new.base_covariance + earlier)[chosen]
    error = np.zeros_like(new.base_covariance)
    if sides.new.base_model_error is not None:
        error = error + sides.new.base_model_error
    if sides.old.base_model_error is not None:
        error = error + transfer @ sides.old.base_model_error @ transfer.T
    # One noise model makes all deviations, so that they are off together: F's denominator.
    uncertain = sum(1.0 / c.dof for c in used)
    dof = len(used) / uncertain if uncertain > 0.0 else math.inf
    statistic, freedom = wald(difference, noise + error[chosen])
    alone = f_tail(*wald(difference, noise), dof)
    test = Significance(f_tail(statistic, freedom, dof), alone)
    return JointTest(statistic, freedom, dof, test)
