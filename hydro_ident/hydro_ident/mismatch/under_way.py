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

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.force_rows import forces_of
from hydro_ident.mismatch.material import Place, Stretch
from hydro_ident.mismatch.modelled import Model
from hydro_ident.mismatch.shaping import Signals
from hydro_model.effects.targets import ActiveEffect, joint_of
from hydro_model.robot import FloatArray

#: Share of the squares left at a stretch's head that a mode under way there takes at least.
_SHARE = 0.5
#: The head of a stretch: so many of the mode's time constants, periods at least, seconds at most.
_CONSTANTS, _PERIODS, _LONGEST_S = 2.0, 3.0, 10.0
#: Rows of a head at least, and deviations from nothing of what a mode does along the stretch.
_ROWS, _TOLD = 12, 5.0
#: Base columns that hardly differ from others take nothing of their own.
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
    for s, stretch in enumerate(signals.stretches(model)):
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
    base = signals.regressor(stretch, stretch.moved)[:, joint]
    values = _beyond(base, np.column_stack([left[place.rows], driven, *free]))
    y, columns = values[:, 0], values[:, 1:]
    scales = np.linalg.norm(columns, axis=0)
    if not scales.all():
        return None
    gram = (columns / scales).T @ (columns / scales)
    sizes = np.linalg.pinv(gram) @ ((columns / scales).T @ y)
    swung = y - (columns / scales) @ sizes
    at_rest_left = y - columns[:, 0] * float(columns[:, 0] @ y) / scales[0] ** 2
    most = (1.0 - _SHARE) * float(at_rest_left[head] @ at_rest_left[head])
    deviation = math.sqrt(float(np.linalg.pinv(gram)[0, 0]) * float(np.mean(swung**2)))
    if float(swung[head] @ swung[head]) > most or sizes[0] < _TOLD * deviation:
        return None
    # What is tried may be a multiple of what is there: its state is that of the mode all along.
    state = sizes / scales
    return np.asarray(state[1:] / state[0])


def _head(since_s: FloatArray, one: ActiveEffect) -> BoolArray:
    """Rows at the head of a stretch, by what has passed since then in s."""
    frequency_hz, damping = one.parameters[1:3]
    constant_s = 1.0 / max(2.0 * math.pi * frequency_hz * damping, 1.0 / _LONGEST_S)
    reach_s = max(_CONSTANTS * constant_s, _PERIODS / frequency_hz)
    return np.asarray(since_s <= min(reach_s, _LONGEST_S))


def _beyond(base: FloatArray, values: FloatArray) -> FloatArray:
    """Columns (T, m) without what base columns (T, p), and a constant, may take of them."""
    base = np.column_stack([base[:, base.any(axis=0)], np.ones(len(base))])
    left, sizes, _ = np.linalg.svd(base / np.linalg.norm(base, axis=0), full_matrices=False)
    basis = left[:, sizes > _TINY * sizes[0]]
    return np.asarray(values - basis @ (basis.T @ values))
