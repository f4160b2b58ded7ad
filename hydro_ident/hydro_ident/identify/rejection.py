"""Stages of an identification that are not to be used, and why.

A stage is the forces as a whole or the hydraulics of one cylinder. It is rejected where a value
is clearly outside physical bounds, where the mass matrix would not be positive definite, where it
predicts held-out data worse than their mean or than the given robot, or where its signals were
swapped. A rejected stage is said and never replaced: the given numbers stay in the model.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.effects.listed_laws import NULL_BIAS
from hydro_ident.estimate.flows.chambers import INVERSE_BULK, OVER_BULK
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit, edges_off
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.forces.bounds import conditioned, effect_bounds
from hydro_ident.estimate.forces.closed_chain import HeldPart
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.scoring.scores import ChannelScore
from hydro_ident.identify.estimation import Estimates
from hydro_ident.identify.identified_robot import has_definite_mass, identified_robot
from hydro_ident.identify.swapped_signals import Swapped
from hydro_ident.parameters.parameters import Parameter, cylinder_parameters
from hydro_ident.robots.robot_ranges import cylinder_ranges
from hydro_ident.robots.robot_units import unit_errors
from hydro_model.robot import Robot

#: A held-out error of more than this multiple of the given robot's is clearly worse.
WORSE = 1.2
#: An error within this multiple of the sensors' noise is no failure, whatever it is compared with.
QUIET = 2.0
_CAUSES = "; likely causes:"


def within_bounds(robot: Robot, estimates: Estimates) -> Estimates:
    """Listed effects of the chambers held at their catalogue bounds, or their stage rejected.

    The forces' are held while they are fitted (`hydro_ident.estimate.forces.bounds`).

    Parameters
    ----------
    robot : Robot
    estimates : Estimates

    Returns
    -------
    Estimates
        A value outside by no more than noise is held at the bound, and the cylinder's other
        parameters are those of a fit without its column.
    """
    hydraulic = estimates.hydraulic
    if hydraulic is None:
        return estimates
    biases = estimates.effects.biases
    cylinders = tuple(c if c.rejected else _bounded(robot, c, biases) for c in hydraulic.cylinders)
    return replace(estimates, hydraulic=replace(hydraulic, cylinders=cylinders))


def _bounded(robot: Robot, fit: CylinderFit, biases: dict[str, float]) -> CylinderFit:
    columns = {f"{fit.cylinder}.{n.removesuffix(OVER_BULK)}": n for n in fit.names}
    while True:
        held: list[HeldPart] = []
        for row in cylinder_parameters(robot, fit, biases):
            owner, _, rest = row.name.partition(f"{fit.cylinder}.")
            if owner or "." not in rest or not row.identifiable:
                continue
            limits, column = effect_bounds(row.name), columns[row.name]
            value = _unclipped(fit, row, column)
            if limits.clear(value, row.std):
                why = limits.text(row.name, value, row.std)
                return replace(fit, rejected=f"{why}{_causes(robot)}")
            if limits.nearest(value) != value:
                reason = limits.held_text(value, row.std)
                at = fit.names.index(column)
                held.append(HeldPart(at, limits.nearest(value), reason))
        if not held:
            return fit
        fit = _holding(fit, held)


def _unclipped(fit: CylinderFit, row: Parameter, column: str) -> float:
    """A null bias stops at its bounds: the step that is left says how far it would go."""
    return row.value + (fit.value(NULL_BIAS)[0] if column == NULL_BIAS else 0.0)


def _holding(fit: CylinderFit, held: Sequence[HeldPart]) -> CylinderFit:
    inverse = fit.value(INVERSE_BULK)[0]
    values = {}
    for part in held:
        name = fit.names[part.index]
        over = inverse if name.endswith(OVER_BULK) else 1.0
        values[part.index] = 0.0 if name == NULL_BIAS else part.value * over
    theta, covariance = conditioned(fit.theta, fit.covariance, values)
    known = np.array(fit.identifiable)
    known[list(values)] = False
    return replace(
        fit,
        theta=theta,
        covariance=covariance,
        identifiable=tuple(map(bool, known)),
        held=(*fit.held, *held),
    )


def tested(
    robot: Robot,
    estimates: Estimates,
    scores: Sequence[ChannelScore],
    swapped: Mapping[str, Swapped],
    odd_rates: Sequence[str],
) -> Estimates:
    """Reject the stages that make no possible machine or fail on held-out data.

    Parameters
    ----------
    robot : Robot
        As given.
    estimates : Estimates
    scores : sequence of ChannelScore
        On held-out rows.
    swapped : mapping of str to Swapped
        Cylinders whose signals were likely swapped, by name.
    odd_rates : sequence of str
        Recordings whose rate is none of the machine's.

    Returns
    -------
    Estimates
    """
    inertial, hydraulic = estimates.inertial, estimates.hydraulic
    if inertial is not None:
        why = _of_forces(robot, inertial, scores, swapped)
        # Nothing that bends with the time holds of the machine; its weight alone would.
        if odd_rates and _of_other_time(hydraulic):
            why = "the rate of the recording and the edges of all valves are off by a unit of time"
        inertial = replace(inertial, rejected=why)
    if hydraulic is not None:
        cylinders = []
        for fit in hydraulic.cylinders:
            if (found := swapped.get(fit.cylinder)) is not None:
                cylinders.append(fit.of_other_signals(found.why))
                continue
            why = fit.rejected or _failed(robot, scores, _flows(robot, fit))
            why = why or _of_no_valve(robot, fit, hydraulic)
            cylinders.append(replace(fit, rejected=why))
        hydraulic = replace(hydraulic, cylinders=tuple(cylinders))
    return replace(estimates, inertial=inertial, hydraulic=hydraulic)


def _of_forces(
    robot: Robot,
    inertial: InertialFit,
    scores: Sequence[ChannelScore],
    swapped: Mapping[str, Swapped],
) -> str:
    """Why the forces cannot be used; empty where they can."""
    # Until here, bounds alone.
    outside = f"{inertial.rejected}{_causes(robot)}" if inertial.rejected else ""
    why = outside or _impossible(robot, inertial)
    why = why or _failed(robot, scores, inertial.model.channels)
    wrong = [text for found in swapped.values() for text in found.pressures]
    if not wrong:
        return why
    cause = f"the flows go by {', '.join(wrong)}: these pressures are likely swapped"
    return f"{why.partition(_CAUSES)[0]}; {cause}" if why else cause


def _of_other_time(hydraulic: HydraulicFit | None) -> bool:
    """Whether all valves' edges are off by a unit: one alone may be of its own voltage's."""
    fits = hydraulic.cylinders if hydraulic is not None else ()
    return bool(fits) and all(edges_off(fit) != 1.0 for fit in fits)


def _of_no_valve(robot: Robot, fit: CylinderFit, hydraulic: HydraulicFit) -> str:
    """What `check_robot` would call an error of a cylinder's valve; empty where nothing is."""
    found = identified_robot(robot, None, replace(hydraulic, cylinders=(fit,)))
    remarks = unit_errors(found, cylinder_ranges(found))
    wrong = [text for about, text in remarks if about == fit.valve]
    return f"no valve has the edges found: {'; '.join(wrong)}" if wrong else ""


def rejections(
    robot: Robot, inertial: InertialFit | None, hydraulic: HydraulicFit | None
) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Why stages were rejected, and their channels, by what a stage is called.

    Parameters
    ----------
    robot : Robot
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    """
    found = {}
    if inertial is not None and inertial.rejected:
        found["forces"] = inertial.rejected, tuple(inertial.model.channels)
    for fit in hydraulic.cylinders if hydraulic is not None else ():
        if fit.rejected:
            found[f"hydraulics of {fit.cylinder}"] = fit.rejected, _flows(robot, fit)
    return found


def rejected_channels(
    robot: Robot, inertial: InertialFit | None, hydraulic: HydraulicFit | None
) -> set[str]:
    """Channels whose numbers are those of a fit that is not in the model.

    Parameters
    ----------
    robot : Robot
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    """
    stages = rejections(robot, inertial, hydraulic).values()
    return {name for _, channels in stages for name in channels}


def _flows(robot: Robot, fit: CylinderFit) -> tuple[str, str]:
    joint = robot.cylinder(fit.cylinder).joint
    return f"{joint}/flow_a", f"{joint}/flow_b"


def _impossible(robot: Robot, inertial: InertialFit) -> str:
    """Why no machine has these base parameters; empty where one could."""
    if has_definite_mass(identified_robot(robot, inertial, None)):
        return ""
    rest = ""
    if not all(inertial.identifiable[: len(inertial.model.base.names)]):
        rest = ", with the robot file's for those that were not determined,"
    return f"the base parameters{rest} make no positive definite mass matrix{_causes(robot)}"


def _failed(robot: Robot, scores: Sequence[ChannelScore], channels: Collection[str]) -> str:
    """Which channels are predicted too badly; empty where none is."""
    found = []
    for score in scores:
        if score.name not in channels:
            continue
        s = score.summary()
        before, after = float(s["rmse_before"]), float(s["rmse_after"])
        fit, floor = float(s["fit_after_pct"]), float(s["noise_floor"])
        if after <= QUIET * floor:
            continue
        # As root mean square. Of what hardly moves the mean is as good as any model.
        moved = after / (1.0 - fit / 100.0) if fit < 0.0 else 0.0
        if moved > QUIET * floor:
            found.append(f"{score.name} is predicted worse than by its mean (fit {fit:.0f} %)")
        elif after > WORSE * before:
            found.append(
                f"{score.name} is predicted worse than by the given robot (RMSE {after:.3g}"
                f" {score.unit}, given {before:.3g} {score.unit})"
            )
    return f"on held-out data {', '.join(found)}{_causes(robot)}" if found else ""


def _causes(robot: Robot) -> str:
    return (
        f"{_CAUSES} the robot file is of another machine, signals or their signs are"
        f" swapped, robot {robot.name} lacks an effect, the recordings carry different loads (each"
        " is then to be identified alone), positions are noisy beside their accelerations (finer"
        " encoders, /joint_reference or slower cut-offs help), or the training motion was too poor"
        f" (play a run of `excite --robot {robot.name}` and record it)"
    )
