"""Modes that are under way when a recording begins.

A link that hardly damps its mode swings on for seconds after whatever moved it. What it does at
the head of a recording follows from nothing that was recorded: its deflection and rate there are
two unknowns of each stretch, of which its force is a multiple, and are had by least squares beside
the base's columns. They are taken where they are most of what is left at the head of a stretch: a
mode at rest stays at rest.
"""

from __future__ import annotations

import math

import numpy as np

from hydro_ident.estimate.forces.force_rows import Motion
from hydro_ident.mismatch.rows.force_rows import forces_of
from hydro_ident.mismatch.rows.material import Place, Stretch
from hydro_ident.mismatch.rows.modelled import Model
from hydro_ident.mismatch.rows.shaping import Signals
from hydro_model.arrays import BoolArray
from hydro_model.effects.targets import ActiveEffect, joint_of
from hydro_model.robot import FloatArray

#: Share of the squares left at a stretch's head from which a mode under way there is taken, and
#: from which wholly.
_SHARES = 0.4, 0.6
#: Sizes that are fitted: of what the mode does, and of either state.
_SIZES = 3
#: The head of a stretch: so many of the mode's time constants, periods at least, seconds at most.
_CONSTANTS, _PERIODS, _LONGEST_S = 2.0, 3.0, 10.0
#: Rows of a head at least, and deviations from nothing of what a mode does along the stretch.
_ROWS, _TOLD = 12, 5.0
#: Columns that hardly differ from others span nothing of their own.
_TINY = 1.0e-6


def under_way(
    signals: Signals, model: Model, one: ActiveEffect, left: FloatArray, at_rest: FloatArray
) -> FloatArray:
    """What a mode adds by swinging at the head of stretches, (N,).

    Parameters
    ----------
    signals : Signals
    model : Model
        Without the mode.
    one : ActiveEffect
        The mode.
    left : (N,) array
        Residual of the model.
    at_rest : (N,) array
        What the mode adds where it begins at rest.
    """
    material, result = signals.material, np.zeros(left.size)
    joint = joint_of(material.robot, one)
    for s, stretch in enumerate(signals.readings.stretches(model)):
        places = [p for p in material.places if p.stretch == s]
        places = [p for p in places if not material.is_flow(p.channel)]
        own = [p for p in places if material.joint_of(p.channel) == joint]
        if not own or stretch.moved is None:
            continue
        torques = signals.changes.free(model.robot, one, stretch, stretch.moved)
        free = np.stack([forces_of(material, model.robot, stretch, t) for t in torques])
        state = _state(signals, stretch, own[0], one, left, at_rest, free[:, :, joint])
        if state is not None:
            for place in places:
                result[place.rows] += state @ free[:, :, material.joint_of(place.channel)]
    return result


def _state(
    signals: Signals,
    stretch: Stretch,
    place: Place,
    one: ActiveEffect,
    left: FloatArray,
    at_rest: FloatArray,
    free: FloatArray,
) -> FloatArray | None:
    """Deflection beyond rest and rate at the head of a stretch; None of a mode that rests there.

    What the base's columns may take of any of it is no part of it: they have been fitted without.
    """
    time_s, joint = signals.material.time_s[place.rows], signals.material.joint_of(place.channel)
    head = _head(time_s - stretch.trace.time_s[0], one)
    driven = at_rest[place.rows]
    if np.count_nonzero(head) < _ROWS or stretch.moved is None or not driven.any():
        return None
    basis = _spanned(signals, stretch, stretch.moved, joint)
    freedom = time_s.size - basis.shape[1] - _SIZES
    if freedom < _ROWS:
        return None
    values = np.column_stack([left[place.rows], driven, *free])
    values -= basis @ (basis.T @ values)
    y, columns = values[:, 0], values[:, 1:]
    scales = np.linalg.norm(columns, axis=0)
    if not scales.all():
        return None
    gram = (columns / scales).T @ (columns / scales)
    sizes = np.linalg.pinv(gram) @ ((columns / scales).T @ y)
    swung = y - (columns / scales) @ sizes
    at_rest_left = y - columns[:, 0] * float(columns[:, 0] @ y) / scales[0] ** 2
    gone = float(swung[head] @ swung[head]) / max(
        float(at_rest_left[head] @ at_rest_left[head]), 1e-300
    )
    deviation = math.sqrt(float(np.linalg.pinv(gram)[0, 0]) * float(swung @ swung) / freedom)
    # By degrees: fits look at how little changes what it does.
    share = (1.0 - gone - _SHARES[0]) / (_SHARES[1] - _SHARES[0])
    if share <= 0.0 or sizes[0] < _TOLD * deviation:
        return None
    # What is tried may be a multiple of what is there: its state is that of the mode all along.
    state = sizes / scales
    return np.asarray(min(share, 1.0) * state[1:] / state[0])


def _head(since_s: FloatArray, one: ActiveEffect) -> BoolArray:
    """Rows at the head of a stretch, by what has passed since then in s."""
    frequency_hz, damping = one.parameters[1:3]
    constant_s = 1.0 / max(2.0 * math.pi * frequency_hz * damping, 1.0 / _LONGEST_S)
    reach_s = max(_CONSTANTS * constant_s, _PERIODS / frequency_hz)
    return np.asarray(since_s <= min(reach_s, _LONGEST_S))


def _spanned(signals: Signals, stretch: Stretch, moved: Motion, joint: int) -> FloatArray:
    """Orthonormal basis of a joint's base columns and a constant, (T, r), kept by the motion."""
    key = stretch.number, joint
    kept = signals.spans.get(key)
    if kept is None or kept[0] is not moved:
        columns = signals.regressor(stretch, moved)[:, joint]
        columns = np.column_stack([columns[:, columns.any(axis=0)], np.ones(len(columns))])
        columns /= np.linalg.norm(columns, axis=0)
        left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        kept = signals.spans[key] = moved, left[:, sizes > _TINY * sizes[0]]
    return kept[1]
