"""Listed effects of a robot as the arrays that the compiled compensation works on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro_control.compensation.listed_laws import NUDGE, adding, rounded
from hydro_control.compensation.signal_inverse import POINTS, SignalInverse
from hydro_control.state.axes import Axis
from hydro_model.arrays import IntArray
from hydro_model.effects import ActiveEffect, Stage
from hydro_model.effects.compiled import law_address
from hydro_model.effects.rows import constant_signals, other_joint
from hydro_model.effects.signals import SIGNAL_COUNT, VALVE_SIGNAL
from hydro_model.robot import FloatArray, Robot

# Columns of `ListedArrays.at`, `.oil`, `.terms`, `.effects`, `.laws` and `.wanted`.
CYLINDER, OTHER = range(2)
AREA_A, AREA_B, BULK = range(3)
ADDRESS, EFFECT = range(2)
AXIS, FIRST_STATE, STATE_COUNT = range(3)
RATE, INITIAL = range(2)
START, STEP = range(2)


class ListedArrays(NamedTuple):
    """The laws that add something; n axes, e effects, t laws, k internal states of effects."""

    at: IntArray  # (n, 2) place among the robot's cylinders; the joint beside it, -1: none
    oil: FloatArray  # (n, 3)
    terms: IntArray  # (t, 2) address of the law, and its effect
    spans: IntArray  # (n, stages, 2) rows of `terms`
    effects: IntArray  # (e, 3)
    parameters: FloatArray  # (e, p) padded with zeros
    laws: IntArray  # (k, 2) addresses of the laws of a state's rate and of its value at rest
    nudge: FloatArray  # (k,) step of the difference that linearises the rate
    inverted: NDArray[np.bool_]  # (n,) the valve's signal laws have an inverse
    wanted: FloatArray  # (n, 2) openings, evenly spaced, and
    given: FloatArray  # (n, POINTS) the signals to give for them; none where all have no inverse


class ListedWork(NamedTuple):
    """What is known from sample to sample; averages and states are NaN where nothing is yet."""

    signals: FloatArray  # (n, SIGNAL_COUNT) what laws see
    states: FloatArray  # (k,) internal states of effects
    leak: FloatArray  # (n,) average of what flows past the valve, as a flow term
    slow: FloatArray  # (n,) average of the openings wanted


def listed_arrays(
    robot: Robot,
    effects: Sequence[ActiveEffect],
    axes: Sequence[Axis],
    inverses: Sequence[SignalInverse | None],
    smallest_scale_m_s: float,
) -> ListedArrays:
    """The arrays of the listed effects of a robot.

    Parameters
    ----------
    robot : Robot
    effects : sequence of ActiveEffect
        Those to compensate.
    axes : sequence of Axis
        Of the robot.
    inverses : sequence of SignalInverse or None
        By axis.
    smallest_scale_m_s : float
        Smallest rounding of the sign of a velocity.

    Returns
    -------
    ListedArrays
    """
    own = [adding(a for a in effects if a.cylinder == x.cylinder_index) for x in axes]
    flat = [one for of_axis in own for one in of_axis]
    terms, spans = _terms(own)
    states = [state for one in flat for state in one.effect.states]
    others = [other_joint(robot, robot.joint_index(a.joint.name)) for a in axes]
    oils = [(c.area_a_m2, c.area_b_m2, c.bulk_modulus_pa) for c in (a.cylinder for a in axes)]
    points = POINTS if any(inverses) else 0
    wanted, given = np.zeros((len(axes), 2)), np.zeros((len(axes), points))
    for i, inverse in enumerate(inverses):
        if inverse is not None:
            wanted[i], given[i] = inverse.table
    return ListedArrays(
        at=np.array(list(zip((a.cylinder_index for a in axes), others, strict=True))),
        oil=np.array(oils),
        terms=terms,
        spans=spans,
        effects=_owners(own),
        parameters=_padded([rounded(one, smallest_scale_m_s) for one in flat]),
        laws=_integers([(law_address(s.rate), law_address(s.initial)) for s in states], 2),
        nudge=np.array([NUDGE * state.scale for state in states], dtype=np.float64),
        inverted=np.array([inverse is not None for inverse in inverses]),
        wanted=wanted,
        given=given,
    )


def listed_work(robot: Robot, axes: Sequence[Axis], arrays: ListedArrays) -> ListedWork:
    """Working memory for the kernels, as before the first sample.

    Parameters
    ----------
    robot : Robot
    axes : sequence of Axis
    arrays : ListedArrays
        Of the robot.

    Returns
    -------
    ListedWork
    """
    nothing = np.full((2, len(axes)), np.nan)
    return ListedWork(signals_at_first(robot, axes), np.full(len(arrays.laws), np.nan), *nothing)


def signals_at_first(robot: Robot, axes: Sequence[Axis]) -> FloatArray:
    """What laws see before the first sample: what is constant, and shut valves; else NaN.

    Parameters
    ----------
    robot : Robot
    axes : sequence of Axis

    Returns
    -------
    (n, SIGNAL_COUNT) array
    """
    rows = np.full((len(axes), SIGNAL_COUNT), np.nan)
    for row, axis in zip(rows, axes, strict=True):
        for index, value in constant_signals(robot, axis.cylinder_index, None).items():
            row[index] = value
        row[VALVE_SIGNAL] = 0.0
    return rows


def _terms(own: Sequence[Sequence[ActiveEffect]]) -> tuple[IntArray, IntArray]:
    rows: list[tuple[int, int]] = []
    spans = np.zeros((len(own), len(Stage), 2), dtype=np.int64)
    before = 0
    for axis, effects in enumerate(own):
        for code, stage in enumerate(Stage):
            start = len(rows)
            for index, one in enumerate(effects, before):
                laws = [term.law for term in one.terms if term.stage is stage]
                rows += [(law_address(law), index) for law in laws if stage is not Stage.SIGNAL]
            spans[axis, code] = start, len(rows)
        before += len(effects)
    return _integers(rows, 2), spans


def _owners(own: Sequence[Sequence[ActiveEffect]]) -> IntArray:
    rows, first = [], 0
    for axis, effects in enumerate(own):
        for one in effects:
            rows.append((axis, first, len(one.effect.states)))
            first += len(one.effect.states)
    return _integers(rows, 3)


def _integers(rows: Sequence[tuple[int, ...]], width: int) -> IntArray:
    return np.array(rows, dtype=np.int64).reshape(-1, width)


def _padded(rows: Sequence[Sequence[float]]) -> FloatArray:
    table = np.zeros((len(rows), max(map(len, rows), default=0)))
    for target, row in zip(table, rows, strict=True):
        target[: len(row)] = row
    return table
