"""Physics that a model leaves out, seen as residuals far above the sensors' noise.

Intervals count noise alone: where much more is left, parameters may be off by more than they say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from hydro_ident.estimate.forces.force_rows import LateForce
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.scoring.scores import ChannelScore
from hydro_ident.identify.channel_scores import LEFT_OUT
from hydro_ident.parameters.parameter_names import parts_of
from hydro_ident.parameters.parameters import COMMAND_DELAY, Parameter
from hydro_model.robot import Robot


def left_out(scores: Sequence[ChannelScore]) -> dict[str, float]:
    """Residual over noise floor of the channels where it exceeds `LEFT_OUT`."""
    found = {}
    for score in scores:
        summary = score.summary()
        floor, after = float(summary["noise_floor"]), float(summary["rmse_after"])
        if floor > 0.0 and after > LEFT_OUT * floor:
            found[score.name] = after / floor
    return found


def model_error_note(scores: Sequence[ChannelScore]) -> str:
    """What the scores say of the stated intervals; empty where they hold."""
    ratios = left_out(scores)
    if not ratios:
        return ""
    sizes = ", ".join(f"{name} {ratio:.0f} times" for name, ratio in ratios.items())
    return (
        f"physics is left out of the model: residuals exceed what sensor noise leaves ({sizes}),"
        " so that the parameters of these channels may be off by more than their intervals say"
    )


def late_note(late: LateForce, fit: InertialFit) -> str:
    """That forces look late, and what it does to a friction.

    Parameters
    ----------
    late : LateForce
    fit : InertialFit
        Whose friction it is.
    """
    value = float(fit.fit.theta[fit.model.names.index(late.friction)])
    when = "after" if late.late_s > 0.0 else "before"
    at_zero = any(one.friction == late.friction for one in fit.early)
    which = "at which it is held" if at_zero else "which is more than its interval says"
    return (
        f"forces of {', '.join(late.channels)} are as though read {abs(late.late_s) * 1e3:.3g} ms"
        f" {when} the positions (+- {late.std_s * 1e3:.2g} ms, one standard deviation): without"
        f" that, {late.friction} would be {late.value:.4g} in place of {value:.4g},"
        f" {which}"
    )


def flagged(
    parameters: Sequence[Parameter],
    robot: Robot,
    inertial: InertialFit | None,
    ratios: Mapping[str, float],
    late: Sequence[LateForce] = (),
) -> tuple[Parameter, ...]:
    """Mark the parameters whose channels leave physics out.

    Parameters
    ----------
    parameters : sequence of Parameter
    robot : Robot
    inertial : InertialFit or None
        Its parameters are fitted to all force channels together.
    ratios : mapping of str to float
        See `left_out`.
    late : sequence of LateForce
        Of which the frictions are off.

    Returns
    -------
    tuple of Parameter
    """
    forces = inertial.model.channels if inertial is not None else ()
    of_forces = set(inertial.model.names) if inertial is not None else set()
    joints = {c.name: c.joint for c in robot.cylinders}
    joints |= {v.name: joints[v.cylinder] for v in robot.valves}
    flows = [f"{c.joint}/flow_{side}" for c in robot.cylinders for side in "ab"]
    found = []
    for p in parameters:
        if p.name in of_forces:
            channels: Sequence[str] = forces
        elif p.name == COMMAND_DELAY:
            channels = flows
        else:
            joint = joints[parts_of(p.name)[0]]
            channels = (f"{joint}/flow_a", f"{joint}/flow_b")
        marked = p.model_error or any(name in ratios for name in channels)
        marked |= any(one.friction == p.name for one in late)
        found.append(replace(p, model_error=marked))
    return tuple(found)
