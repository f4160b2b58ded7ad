"""Output-error refinement: effects and base fitted to roll-outs, kept where these get better.

Equation errors weigh what the sensors and filters show within a cycle or a window of 40 ms; a
simulation is judged by what adds up over seconds. Starting from the equation-error fit, the free
parameters of all effects are fitted by multiple shooting, and with them the base, held by what the
equation-error fit knows of it. The outcome replaces that fit only where held-out windows are
rolled out better, beyond chance, and no parameter goes where the equations say it cannot be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.identify.identified_robot import has_definite_mass
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.zeros import of_zeros
from hydro_ident.mismatch.modelling.refined_robot import Refinable
from hydro_ident.mismatch.modelling.shooting import Solution, Unknowns, shoot
from hydro_ident.mismatch.modelling.shots import Shots, sensor_noise, weights_of
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.settings import FORM_TOLERANCE, RefineSettings
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import at_a_bound
from hydro_ident.mismatch.trials.products import chance
from hydro_ident.mismatch.verifying.looks import VERIFIED, WORSE
from hydro_model.robot import FloatArray, Robot

#: Steps of a fit, and trials of a step that a budget counts with.
_PASSES, _TRIALS = 4, 2
#: Windows that a decision needs; per unknown that is not held, so many to fit on.
LEAST_WINDOWS, _PER_UNKNOWN = 6, 2
#: Deviations of both fits together beyond which a parameter has left its interval.
_IMPLAUSIBLE = 3.0


@dataclass(frozen=True, slots=True)
class RefinedParameter:
    """A parameter before and after.

    Attributes
    ----------
    name, unit : str
        `<target>.<effect>.<parameter>`.
    before, value : float
        By equation errors, by output errors.
    before_std, std : float
        Of the fits, and of the form of a law, which is an idealisation.
    ci95 : tuple of float
        Within physical bounds.
    """

    name: str
    unit: str
    before: float
    before_std: float
    value: float
    std: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """Outcome of a refinement.

    Attributes
    ----------
    robot : Robot
    whole : Fitted
        Those that go on: refined ones where it was accepted.
    accepted : bool
    reason : str
        Why it was not.
    parameters : tuple of RefinedParameter
    windows, held_out_windows, rollouts : int
    p_value : float
        Of the improvement on held-out windows.
    rmse : dict of str to (float, float)
        Of held-out roll-outs by signal, before and after.
    """

    robot: Robot
    whole: Fitted
    accepted: bool
    reason: str
    parameters: tuple[RefinedParameter, ...] = ()
    windows: int = 0
    held_out_windows: int = 0
    rollouts: int = 0
    p_value: float = 1.0
    rmse: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def note(self) -> str:
        """What happened, in a line."""
        if self.accepted:
            return (
                f"effects and base were refined on {self.windows} roll-outs of training windows;"
                f" {self.held_out_windows} held-out ones are better (p = {self.p_value:.2g})"
            )
        return f"not refined by roll-outs: {self.reason}"


def refine(
    work: Residuals, whole: Fitted, robot: Robot, settings: RefineSettings, fixed_base: bool
) -> Refinement:
    """Refine the effects of a fit by roll-outs over windows of the training recordings.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        By equation errors.
    robot : Robot
        What it describes.
    settings : RefineSettings
    fixed_base : bool
        Only effects are refined.

    Returns
    -------
    Refinement
    """
    kept = Refinement(robot, whole, False, "")
    if not whole.model.terms:
        return replace(kept, reason="there are no effects")
    if robot.dry_joints:
        return replace(kept, reason="not every joint has a cylinder")
    space = Refinable.of(work.training.predictor, whole, robot, fixed_base)
    shots, reason = _training_shots(work, space, settings)
    if reason:
        return replace(kept, reason=reason)
    noise = sensor_noise(work.robot, work.signals)
    weights = weights_of([e for e in space.errors(shots, space.start) if e is not None], noise)

    def errors(x: FloatArray) -> list[FloatArray] | None:
        missed = space.errors(shots, x)
        found = [(e * weights).ravel() for e in missed if e is not None]
        return found if len(found) == len(missed) else None

    solution = shoot(errors, space.unknowns, _PASSES)
    kept = replace(kept, windows=len(shots.spans), rollouts=shots.rollouts)
    if solution is None:
        return replace(kept, reason="windows cannot be rolled out beside the fit's parameters")
    return _decided(work, kept, space, solution, weights, settings)


def _training_shots(
    work: Residuals, space: Refinable, settings: RefineSettings
) -> tuple[Shots, str]:
    """Windows to fit on, and why there are too few; empty where there are enough."""
    predictor, count = work.training.predictor, _windows(space.unknowns, settings)
    shots = Shots.of(predictor, work.split, settings.window_s, count, False)
    if count < LEAST_WINDOWS:
        return shots, f"{settings.rollouts} roll-outs are too few"
    shots = _possible(shots, space)
    least = max(LEAST_WINDOWS, _PER_UNKNOWN * space.free)
    if len(shots.spans) < least:
        return shots, f"{len(shots.spans)} training windows can be rolled out, {least} are needed"
    return shots, ""


def _windows(unknowns: Unknowns, settings: RefineSettings) -> int:
    """Windows that the budget of roll-outs allows."""
    free = int(np.sum(~unknowns.once))
    each = 1 + unknowns.start.size + _PASSES * (free + _TRIALS)
    return min(settings.windows, settings.rollouts // each)


def _possible(shots: Shots, space: Refinable) -> Shots:
    """The windows that the start can be rolled out over."""
    fresh = shots.only([e is not None for e in space.errors(shots, space.start)])
    return replace(fresh, rollouts=shots.rollouts)


def _decided(
    work: Residuals,
    kept: Refinement,
    space: Refinable,
    solution: Solution,
    weights: FloatArray,
    settings: RefineSettings,
) -> Refinement:
    """Held-out windows before and after, and what they and the equations say of the outcome."""
    check = Shots.of(work.check.predictor, work.split, settings.window_s, settings.windows, True)
    there = space.seen_by(at_own_instants(work.training, work.check, kept.whole.model)[0])
    check = _possible(check, there)
    before, after = (there.errors(check, x) for x in (space.start, solution.x))
    parameters = _parameters(kept.whole, space, solution)
    found = replace(
        kept,
        parameters=parameters,
        held_out_windows=len(check.spans),
        rollouts=kept.rollouts + check.rollouts,
    )
    if any(e is None for e in after):
        return replace(found, reason="a held-out window cannot be rolled out with the outcome")
    pairs = [(b, a) for b, a in zip(before, after, strict=True) if b is not None and a is not None]
    if len(pairs) < LEAST_WINDOWS:
        why = f"{len(pairs)} held-out windows, {LEAST_WINDOWS} are needed"
        return replace(found, reason=why)
    gains = np.array([np.sum((b * weights) ** 2) - np.sum((a * weights) ** 2) for b, a in pairs])
    p = chance(gains)
    found = replace(found, p_value=p, rmse=_rmse(work.robot, pairs))
    robot, terms = space.robot(solution.x), space.terms(solution.x)
    reason = _against(found, robot) or next((r for t in terms if (r := at_a_bound(t))), "")
    if reason:
        return replace(found, reason=reason)
    model = space.model(work.training, solution.x)
    whole = fitted(work.training, model, kept.whole.bench.noise)
    covariance = space.covariance(whole, solution.covariance)
    whole = replace(whole, refined=covariance)
    robot = space.with_deviations(robot, covariance + of_zeros(work.training.predictor, whole))
    return replace(found, accepted=True, whole=whole, robot=robot)


def _against(found: Refinement, robot: Robot) -> str:
    """What speaks against an outcome; empty where nothing does."""
    for one in found.parameters:
        both = np.hypot(one.before_std, one.std)
        if np.isfinite(both) and abs(one.value - one.before) > _IMPLAUSIBLE * both:
            return (
                f"{one.name} would go from {one.before:.4g} to {one.value:.4g} {one.unit}, beyond"
                " what the equations leave open"
            )
    if found.p_value > VERIFIED:
        return f"held-out windows are not rolled out better (p = {found.p_value:.2g})"
    for name, (before, after) in found.rmse.items():
        if after > WORSE * before:
            return f"held-out {name} is rolled out worse (RMSE {before:.3g} to {after:.3g})"
    if not has_definite_mass(robot):
        return "the refined base makes no positive definite mass matrix"
    return ""


def _rmse(
    robot: Robot, pairs: Sequence[tuple[FloatArray, FloatArray]]
) -> dict[str, tuple[float, float]]:
    """Roll-out errors by signal, before and after."""
    names = [*robot.joint_names]
    names += [f"{c.name}/{side}" for side in ("a", "b") for c in robot.cylinders]
    sides = [np.concatenate([pair[k] for pair in pairs]) for k in (0, 1)]
    rms = [np.sqrt(np.mean(side**2, axis=0)) for side in sides]
    return {n: (float(b), float(a)) for n, b, a in zip(names, *rms, strict=True)}


def _parameters(
    whole: Fitted, space: Refinable, solution: Solution
) -> tuple[RefinedParameter, ...]:
    """Parameters of the effects before and after."""
    first, fresh = np.diag(whole.covariance), np.diag(solution.covariance)
    result = []
    for i, (name, unit) in enumerate(space.labels):
        before, value = float(space.start[i]), float(solution.x[i])
        variance = float(first[whole.names.index(name)]) if name in whole.names else np.inf
        old = float(np.sqrt(max(variance, 0.0) + (FORM_TOLERANCE * before) ** 2))
        std = float(np.sqrt(max(fresh[i], 0.0) + (FORM_TOLERANCE * value) ** 2))
        reach = solution.quantile * std
        low = max(value - reach, float(space.unknowns.lower[i]))
        high = min(value + reach, float(space.unknowns.upper[i]))
        result.append(RefinedParameter(name, unit, before, old, value, std, (low, high)))
    return tuple(result)
