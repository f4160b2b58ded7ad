"""Forces read a little before or after the positions: what that does to friction.

Transducers filter, a bus carries pressures after positions, a torque may be that of the cycle
before. A force read s late is, to first order, ``F(t) = F_read(t) + s dF_read/dt``. Where the
motion swings at w, ``s dF/dt`` of a mass M and of gravity's spring K is ``-s (M w^2 - K) v``:
friction comes out off by that however long the recording is, and its interval knows nothing of
it.

Nothing is corrected. Physics that a model lacks may look like late forces, and would move into s.
A friction that early forces bring clearly below 0 is held at 0: no machine has it, and the others'
parameters are as good as those beside a friction that late ones bring up by as much.
The rows are fitted once more with a column per s beside the parameters; where that says that
forces are late, and moves friction out of its interval, it is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.forces.bounds import DEVIATIONS
from hydro_ident.estimate.forces.closed_chain import HeldPart
from hydro_ident.estimate.forces.force_rows import (
    ForceModel,
    LateForce,
    measured_force,
    pressed_joints,
)
from hydro_ident.estimate.forces.inertial import InertialFit, parameter_bounds
from hydro_ident.estimate.signals.derivatives import (
    FilterSettings,
    kept_samples,
    parallel_filter,
    smooth_rates,
)
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.blocks import blocks_of
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import solve_wls
from hydro_ident.estimate.statistics.rows import Rows

#: Least and largest time that is told, s: sampled signals are known to no less, and beyond the
#: other it is no small shift of the motion.
_LEAST_S, _MOST_S = 5.0e-5, 1.0e-2


def late_rows(model: ForceModel, trace: Trace, rows: Rows, settings: FilterSettings) -> Rows:
    """Rows of the force channels with a column per time that forces may be late by.

    Parameters
    ----------
    model : ForceModel
    trace : Trace
    rows : Rows
        Of `force_rows` for that trace.
    settings : FilterSettings
    """
    if model.corrected is not None:
        trace = model.corrected(trace)
    settings = settings.borne_at(trace.step_s)
    keep = kept_samples(trace.samples, trace.step_s, settings, trace.cycle, trace.core)
    rates = smooth_rates(measured_force(model, trace), trace.step_s, settings)
    rates = parallel_filter(rates, trace.step_s, settings, keep)
    groups = _groups(model)
    columns = np.zeros((*rates.shape, len(groups)))
    for k, joints in enumerate(groups):
        columns[:, joints, k] = -rates[:, joints]
    return replace(rows, x=np.concatenate([rows.x, columns], axis=2), z=None)


def late_forces(
    fit: InertialFit, gathered: Sequence[Moments], half_widths: Sequence[float]
) -> tuple[LateForce, ...]:
    """Forces that look late by so much that a friction is outside its interval.

    Parameters
    ----------
    fit : InertialFit
    gathered : sequence of Moments
        Of `late_rows`, by recording: those that were fitted. Columns behind theirs are left out.
    half_widths : sequence of float
        Of the parameters' intervals.
    """
    model, size = fit.model, len(fit.model.names)
    groups = _groups(model)
    if sum(int(one.rows.sum()) for one in gathered) <= 10 * (size + len(groups)):
        return ()
    held = [part.index for part in fit.held]
    free = np.setdiff1d(np.arange(size), held)
    shift = np.zeros(gathered[0].width - 1)
    shift[held] = fit.fit.theta[held]
    blocks = blocks_of(gathered)
    both = np.append(free, size + np.arange(len(groups)))
    without, beside = solve_wls(blocks.held(free, shift)), solve_wls(blocks.held(both, shift))
    value, moved = shift[:size].copy(), np.zeros(size)
    value[free] = beside.theta[: free.size]
    moved[free] = value[free] - without.theta
    found = []
    for k, joints in enumerate(groups):
        late_s = float(beside.theta[free.size + k])
        std_s = float(np.sqrt(beside.covariance[free.size + k, free.size + k]))
        if not max(_LEAST_S, DEVIATIONS * std_s) < abs(late_s) < _MOST_S:
            continue
        channels = tuple(model.channels[j] for j in joints)
        found += [
            LateForce(channels, late_s, std_s, model.names[i], float(value[i]))
            for i in _frictions(model, joints)
            if fit.identifiable[i] and abs(moved[i]) > half_widths[i]
        ]
    return tuple(found)


def early_forces(fit: InertialFit, gathered: Sequence[Moments]) -> tuple[LateForce, ...]:
    """Forces read early by so much that a friction is clearly below 0, where it else is not.

    Parameters
    ----------
    fit : InertialFit
    gathered : sequence of Moments
        Of `late_rows`, by recording.
    """
    bounds, names, own = parameter_bounds(fit.model, fit.fit), fit.model.names, fit.fit
    found = []
    for one in late_forces(fit, gathered, [0.0] * len(names)) if gathered else ():
        at = names.index(one.friction)
        below = own.theta[at] < 0.0 and bounds[at].clear(float(own.theta[at]), float(own.std[at]))
        if below and not bounds[at].clear(one.value, float(own.std[at])):
            found.append(one)
    return tuple(found)


def held_at_zero(fit: InertialFit, early: Sequence[LateForce]) -> list[HeldPart]:
    """The frictions of `early_forces`, to be held.

    Parameters
    ----------
    fit : InertialFit
        In which they are below 0.
    early : sequence of LateForce
    """
    parts = []
    for one in early:
        at = fit.model.names.index(one.friction)
        reason = (
            f"held at 0: the fit gives {fit.fit.theta[at]:.3g} +- {fit.fit.std[at]:.2g}, which"
            f" forces read {abs(one.late_s) * 1e3:.3g} ms before the positions explain"
        )
        parts.append(HeldPart(at, 0.0, reason))
    return parts


def _groups(model: ForceModel) -> list[list[int]]:
    """Joints whose forces have one time: each with pressures, and all with measured torques.

    Drives of one machine are alike, and a time of its own would take up what a play does.
    """
    wet = pressed_joints(model)
    dry = [j for j in range(len(model.channels)) if j not in wet]
    return [*([j] for j in wet), *([dry] if dry else [])]


def _frictions(model: ForceModel, joints: Sequence[int]) -> list[int]:
    """Parameters of viscous friction at some joints."""
    robot = model.robot
    movers = [robot.joint_index(c.joint) for c in robot.cylinders] + list(robot.dry_joints)
    return [len(model.base.names) + k for k, joint in enumerate(movers) if joint in joints]
