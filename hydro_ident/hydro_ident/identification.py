"""Identification of a robot from recordings: the pure core of `identify` and of its node.

Paper III-A (base parameters, viscous friction) and III-B (bulk modulus, valve edges), with the
errata of both. A stage that fails is rejected and said; the robot file's own numbers then stay
in the model, and the verdict is `partly_identified`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.recording import Recording
from hydro_ident.channel_scores import flow_scores, force_scores
from hydro_ident.errors import IdentError
from hydro_ident.estimate.chambers import (
    WindowSettings,
)
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.estimate.inertial import (
    ForceModel,
    InertialFit,
    fit_inertial,
    force_model,
)
from hydro_ident.estimate.listed_effects import ListedEffects
from hydro_ident.estimate.scores import ChannelScore, HoldOut
from hydro_ident.estimate.traces import Trace, traces_of
from hydro_ident.identified_robot import identified_robot
from hydro_ident.parameters import Parameter, parameter_list
from hydro_model.robot import Robot

#: Gauss-Newton passes of listed null biases, and the step at which they end.
_BIAS_PASSES, _BIAS_STEP = 12, 1.0e-7

#: A residual this many times the noise floor is not noise.
LEFT_OUT = 5.0

IDENTIFIED, PARTLY, NOT_ENOUGH = "identified", "partly_identified", "not_enough_data"


@dataclass(frozen=True, slots=True)
class Settings:
    """Choices of the estimators.

    Attributes
    ----------
    filters : FilterSettings
    windows : WindowSettings
    """

    filters: FilterSettings = field(default_factory=FilterSettings)
    windows: WindowSettings = field(default_factory=WindowSettings)


@dataclass(frozen=True, slots=True)
class Identification:
    """What was identified, how well it predicts, and what could not be done.

    Attributes
    ----------
    verdict : str
        `identified`, `partly_identified` or `not_enough_data`.
    given : Robot
        The robot that identification started from.
    robot : Robot or None
        The identified robot; None with the verdict `not_enough_data`.
    parameters : tuple of Parameter
    channels : tuple of ChannelScore
    problems : tuple of str
        Why the verdict is not `identified`, a line each.
    notes : tuple of str
        Channels lost, effects held, how channels were scored.
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    settings : Settings
    """

    verdict: str
    given: Robot
    robot: Robot | None
    parameters: tuple[Parameter, ...]
    channels: tuple[ChannelScore, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    inertial: InertialFit | None
    hydraulic: HydraulicFit | None
    settings: Settings


def identify(
    robot: Robot,
    training: Sequence[Recording],
    validation: Sequence[Recording] = (),
    settings: Settings | None = None,
) -> Identification:
    """Identify a robot.

    Parameters
    ----------
    robot : Robot
        Its geometry and its list of effects are used, its numbers only for comparison.
    training : sequence of Recording
        At least one.
    validation : sequence of Recording
        Whole recordings to score on; without them every fifth block of `training` is held out.
    settings : Settings, optional

    Returns
    -------
    Identification

    Raises
    ------
    IdentError
        No recording was given.
    RobotError
        The robot lists an effect that is not in the catalogue.
    """
    if not training:
        raise IdentError("expected at least one recording to identify from, found none")
    _check_names([*training, *validation])
    settings = settings or Settings()
    effects = ListedEffects.of(robot)
    traces = traces_of(training)
    checks = traces_of(validation) if validation else traces
    split = HoldOut(every=0) if validation else _hold_out(training)
    model = _force_model(robot, effects, traces)
    inertial = fit_inertial(model, traces, settings.filters, split.training)
    hydraulic, fitted = _fit_flows(robot, effects, traces, split, settings)
    verdict, problems = _verdict(robot, inertial, hydraulic)
    found = None
    if verdict != NOT_ENOUGH and inertial is not None:
        found = identified_robot(robot, inertial, hydraulic, fitted.biases)
    scores: list[ChannelScore] = []
    if checks:
        scores += force_scores(inertial, robot, checks, split, settings.filters)
        scores += flow_scores(hydraulic, robot, (effects, fitted), checks, split)
    return Identification(
        verdict=verdict,
        given=robot,
        robot=found,
        parameters=parameter_list(robot, inertial, hydraulic, fitted.biases),
        channels=tuple(scores),
        problems=problems,
        notes=(*_notes(training, effects, validation), *_score_notes(scores)),
        inertial=inertial,
        hydraulic=hydraulic,
        settings=settings,
    )


def _check_names(recordings: Sequence[Recording]) -> None:
    """Hold-out blocks, labels and hashes go by a bag's name."""
    names = [recording.path.name for recording in recordings]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise IdentError(f"expected bags of different names, found '{twice[0]}' more than once")


def _score_notes(scores: Sequence[ChannelScore]) -> list[str]:
    """What the scores say of the stated intervals."""
    if not scores:
        return ["no stretch of the bags can be used to check the predictions: nothing was scored"]
    notes = []
    for score in scores:
        summary = score.summary()
        floor, after = float(summary["noise_floor"]), float(summary["rmse_after"])
        if floor > 0.0 and after > LEFT_OUT * floor:
            notes.append(
                f"{score.name}: the residual is {after / floor:.0f} times what sensor noise"
                " leaves; physics is left out, and parameters may be off by more than their"
                " intervals say"
            )
    return notes


def _fit_flows(
    robot: Robot,
    effects: ListedEffects,
    traces: Sequence[Trace],
    split: HoldOut,
    settings: Settings,
) -> tuple[HydraulicFit | None, ListedEffects]:
    """Fit the chambers; where null biases are listed, again until they stay where they are."""
    fit, fitted = None, effects
    for _ in range(_BIAS_PASSES):
        shaped = [fitted.with_signal_laws(trace) for trace in traces]
        fit = fit_hydraulics(
            robot, shaped, settings.windows, fitted.chamber_columns, split.training
        )
        if fit is None or not fitted.biases:
            break
        moved, step = fitted.refined(fit)
        if step < _BIAS_STEP:
            break
        fitted = moved
    return fit, fitted


def _hold_out(recordings: Sequence[Recording]) -> HoldOut:
    return HoldOut.of({r.path.name: max(r.duration_s, 1e-3) for r in recordings})


def _force_model(robot: Robot, effects: ListedEffects, traces: Sequence[Trace]) -> ForceModel:
    wet = any(np.isfinite(t.p_a).any() or np.isfinite(t.p_b).any() for t in traces)
    dry = any(np.isfinite(t.joint_torque).any() for t in traces)
    return force_model(robot, dry and not wet, effects.force_names, effects.force_columns)


def _verdict(
    robot: Robot, inertial: InertialFit | None, hydraulic: HydraulicFit | None
) -> tuple[str, tuple[str, ...]]:
    if inertial is None:
        text = (
            "no force channel: identification needs every joint angle with both chamber"
            " pressures of a cylinder (or a joint torque), for longer than the filters' edges"
        )
        return NOT_ENOUGH, (text,)
    base = [name for name in inertial.missing if name in inertial.model.base.names]
    problems = []
    if inertial.missing:
        problems.append(_motion_problem(robot, inertial))
    if base or (inertial.missing and inertial.still):
        return NOT_ENOUGH, tuple(problems)
    problems += _hydraulic_problems(robot, inertial, hydraulic)
    return (PARTLY if problems else IDENTIFIED), tuple(problems)


def _motion_problem(robot: Robot, inertial: InertialFit) -> str:
    text = f"the data do not determine {', '.join(inertial.missing)}"
    still = [robot.joint_names[j] for j in inertial.still]
    if still:
        return f"{text}: {', '.join(still)} did not move; drive every joint through its range"
    return f"{text}: too little motion; use a run of `excite`"


def _hydraulic_problems(
    robot: Robot, inertial: InertialFit, hydraulic: HydraulicFit | None
) -> list[str]:
    if inertial.model.torque or not robot.valves:
        return []
    fitted = {c.cylinder: c for c in hydraulic.cylinders} if hydraulic else {}
    problems = []
    for valve in robot.valves:
        name = valve.cylinder
        why = fitted[name].rejected if name in fitted else "no flow channel was recorded"
        if why:
            problems.append(f"hydraulics of {name} rejected, the robot file's kept: {why}")
    return problems


def _notes(
    training: Sequence[Recording], effects: ListedEffects, validation: Sequence[Recording]
) -> tuple[str, ...]:
    notes = [
        f"{recording.path.name}: {loss.channel} lost: {loss.reason}"
        for recording in (*training, *validation)
        for loss in recording.losses
    ]
    for recording in (*training, *validation):
        notes += [f"{recording.path.name}: {note}" for note in recording.notes]
        if recording.gaps:
            notes.append(f"{recording.path.name}: {len(recording.gaps)} gaps in the cycles")
    notes += [f"effect {name} taken as listed, not fitted" for name in effects.held]
    if not validation:
        notes.append("scores are of every fifth block of the bags, which was kept from the fit")
    return tuple(notes)
