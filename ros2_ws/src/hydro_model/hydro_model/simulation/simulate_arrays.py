"""A robot and its effects as the arrays that the compiled roll-out works on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro_model.arrays import IntArray
from hydro_model.effects import ActiveEffect, Stage
from hydro_model.effects.bending import next_parallel, usual_inertia
from hydro_model.effects.compiled import law_address, signals_read
from hydro_model.effects.flexibility import STRUCTURAL_FLEXIBILITY, hinged
from hydro_model.effects.rows import constant_signals, other_joint, upwards
from hydro_model.effects.signals import MAX_STATES, SIGNAL_COUNT, STATE_0, VALVE_SIGNAL
from hydro_model.effects.targets import joint_of
from hydro_model.multibody.chain_arrays import chain_arrays
from hydro_model.multibody.chain_kernels import SCRATCH
from hydro_model.robot import Cylinder, FloatArray, Robot, Valve

_STAGES = list(Stage)
# Codes of the stages and of what a right-hand side is asked for. They are numpy integers because
# numba compiles a function anew for every plain integer or truth value that it is called with.
SIGNAL, FRICTION, FLOW_A, FLOW_B, VOLUME_A, VOLUME_B, COMPLIANCE_A, COMPLIANCE_B, SUPPLY, TANK = (
    np.int64(_STAGES.index(stage))
    for stage in (
        Stage.SIGNAL,
        Stage.FRICTION,
        Stage.FLOW_A,
        Stage.FLOW_B,
        Stage.VOLUME_A,
        Stage.VOLUME_B,
        Stage.COMPLIANCE_A,
        Stage.COMPLIANCE_B,
        Stage.SUPPLY,
        Stage.TANK,
    )
)
RATES, KEEP_MASS, REST = np.int64(0), np.int64(1), np.int64(2)

# Columns of `ModelArrays.geometry`, `.terms` and `.owners`.
L1, L2, Q0, X0, AREA_A, AREA_B, STROKE, VISCOUS, INVERSE_BULK = range(9)
ADDRESS, EFFECT, OWNER = range(3)
FIRST_STATE, STATE_COUNT, ROBOT_WIDE, THROUGH_VALVE = range(4)

#: Pressures and rates of change are of this size, Pa: the integrator's unit of pressure.
PRESSURE_SCALE_PA = 1.0e6

#: What laws see that follow from the command alone: the command and their own states.
_OF_COMMAND = frozenset({VALVE_SIGNAL, *range(STATE_0, STATE_0 + MAX_STATES)})


class ModelArrays(NamedTuple):
    """The model in numbers; n joints, m cylinders, e effects, t laws, k states of effects.

    Rows m of `spans` belong to the whole robot, those behind to the d joints without cylinder.
    The state is
    ``[q (n), qd (n), p_a (m), p_b (m), effect states (k)]``.
    """

    rotation: FloatArray  # (n, 3, 3)
    translation: FloatArray  # (n, 3)
    axis: FloatArray  # (n, 3)
    prismatic: NDArray[np.bool_]  # (n,)
    gravity: FloatArray  # (3,)
    tip: FloatArray  # (3,) in the last joint's frame
    up: FloatArray  # (3,) unit vector against gravity
    tip_used: NDArray[np.bool_]  # (1,) some law looks at the tip
    theta: FloatArray  # (n, 11)
    parts: FloatArray  # (2 k, PART_COLUMNS) barrels and rods
    joint: IntArray  # (m,) joint of each cylinder
    other: IntArray  # (n,) the joint that each one's laws may look at, -1: none
    geometry: FloatArray  # (m, 9)
    edges: FloatArray  # (m, 4) c_pa, c_at, c_pb, c_bt
    dry_joint: IntArray  # (d,) joints without cylinder
    dry_viscous: FloatArray  # (d,) their viscous friction
    parameters: FloatArray  # (e, p) padded with zeros
    terms: IntArray  # (t, 3) address of the law, effect, whether it drives the effect's states
    spans: IntArray  # (m + 1 + d, stages, 2) rows of `terms`
    commanded: IntArray  # (m, 2) rows of `terms` up to the last whose states are `known`
    known: IntArray  # (c,) states that follow from the commands alone
    judged: IntArray  # the others: those whose errors hold a step short
    hinges: IntArray  # (h, 4) effect that bends a link, joint, first state, next joint (or -1)
    bends: FloatArray  # (h, 2) where along the link, and what it moves in the middle, kg m^2
    owners: IntArray  # (e, 4) first state, number of states, robot-wide?, of the valve's flow?
    rates: IntArray  # (k,) address of the rate law of each effect state
    initials: IntArray  # (k,) address of the law of its value at rest
    scale: FloatArray  # (2 n + 2 m + k,) typical size of each state


class Work(NamedTuple):
    """Working memory of the kernels; contents carry nothing from call to call but as noted."""

    q: FloatArray  # (n,)
    qd: FloatArray  # (n,)
    chain: FloatArray  # (n + 2 k, SCRATCH)
    tip_slope: FloatArray  # (n,) how much the tip rises with each joint
    mass: FloatArray  # (n, n) mass matrix of the latest full evaluation
    bias: FloatArray  # (n,) and its bias
    factor: FloatArray  # (n + h, n + h)
    force: FloatArray  # (n + h,) joint forces, then accelerations; behind them those of hinges
    signals: FloatArray  # (m + 1 + d, SIGNAL_COUNT) what laws see; rows as of `spans`
    friction: FloatArray  # (m,) N
    flows: FloatArray  # (4,) of the latest cylinder, m^3/s: into chambers, and at its valve


def model_arrays(robot: Robot, active: Sequence[ActiveEffect], plain: Robot) -> ModelArrays:
    """The arrays of a robot with the given effects.

    Parameters
    ----------
    robot : Robot
    active : sequence of ActiveEffect
        Those with laws, in catalogue order, as `hydro_model.effects.resolve` returns them.
    plain : Robot
        Without what its effects change of it: a load takes no spring away and gives none.

    Returns
    -------
    ModelArrays

    Raises
    ------
    RobotError
        A cylinder has no valve.
    """
    chain = chain_arrays(robot)
    cylinders = robot.cylinders
    valves = [robot.valve_of(cylinder.name) for cylinder in cylinders]
    terms, spans = _terms(active, _places(robot))
    states = [state for one in active for state in one.effect.states]
    rigid = 2 * robot.dof
    owners = _owners(active, rigid + 2 * len(cylinders))
    commanded, known = _commanded(active, terms, spans, owners, len(cylinders))
    hinges = _hinges(robot, active, owners)
    scale = [1.0] * rigid + [PRESSURE_SCALE_PA] * (2 * len(cylinders))
    return ModelArrays(
        rotation=chain.rotation,
        translation=chain.translation_m,
        axis=chain.axis,
        prismatic=chain.prismatic,
        gravity=chain.gravity_m_s2,
        tip=np.array(robot.tip_offset_m, dtype=np.float64),
        up=upwards(robot),
        tip_used=np.array([any(one.effect.needs_tip for one in active)]),
        theta=chain.theta,
        parts=chain.parts,
        joint=np.array([robot.joint_index(c.joint) for c in cylinders], dtype=np.int64),
        other=np.array([other_joint(robot, j) for j in range(robot.dof)], dtype=np.int64),
        geometry=np.array([_geometry(c) for c in cylinders], dtype=float).reshape(-1, 9),
        edges=np.array([_edges(v) for v in valves], dtype=float).reshape(-1, 4),
        dry_joint=np.array(robot.dry_joints, dtype=np.int64),
        dry_viscous=np.array([robot.joints[j].viscous_friction for j in robot.dry_joints]),
        parameters=_padded(active),
        terms=terms,
        spans=spans,
        commanded=commanded,
        known=known,
        judged=np.setdiff1d(np.arange(rigid + 2 * len(cylinders) + len(states)), known),
        hinges=hinges,
        bends=_bends(plain, active, hinges),
        owners=owners,
        rates=np.array([law_address(state.rate) for state in states], dtype=np.int64),
        initials=np.array([law_address(state.initial) for state in states], dtype=np.int64),
        scale=np.array(scale + [state.scale for state in states]),
    )


def new_work(robot: Robot, hinges: int) -> Work:
    """Working memory for a robot with so many hinges; signals that no roll-out knows are NaN."""
    n, m = robot.dof, len(robot.cylinders)
    signals = np.full((len(_places(robot)), SIGNAL_COUNT), np.nan)
    for row, (cylinder, joint) in zip(signals, _places(robot), strict=True):
        for index, value in constant_signals(robot, cylinder, joint).items():
            row[index] = value
    return Work(
        q=np.zeros(n),
        qd=np.zeros(n),
        chain=np.zeros((n + 2 * len(robot.closed_chains), SCRATCH)),
        tip_slope=np.zeros(n),
        mass=np.zeros((n, n)),
        bias=np.zeros(n),
        factor=np.zeros((n + hinges, n + hinges)),
        force=np.zeros(n + hinges),
        signals=signals,
        friction=np.zeros(m),
        flows=np.zeros(4),
    )


def _geometry(c: Cylinder) -> list[float]:
    triangle = [c.l1_m, c.l2_m, c.q0_rad, c.x0_m]
    areas = [c.area_a_m2, c.area_b_m2, c.stroke_m]
    return [*triangle, *areas, c.viscous_friction, 1.0 / c.bulk_modulus_pa]


def _edges(v: Valve) -> list[float]:
    return [v.c_pa, v.c_at, v.c_pb, v.c_bt]


def _padded(active: Sequence[ActiveEffect]) -> FloatArray:
    width = max((len(one.parameters) for one in active), default=0)
    table = np.zeros((len(active), width))
    for row, one in zip(table, active, strict=True):
        row[: len(one.parameters)] = one.parameters
    return table


def _owners(active: Sequence[ActiveEffect], first: int) -> IntArray:
    table = np.zeros((len(active), 4), dtype=np.int64)
    for row, one in zip(table, active, strict=True):
        row[:] = first, len(one.effect.states), one.effect.robot_wide, one.effect.needs_valve
        first += len(one.effect.states)
    return table


def _hinges(robot: Robot, active: Sequence[ActiveEffect], owners: IntArray) -> IntArray:
    rows = []
    for index, one in enumerate(active):
        if one.effect.name == STRUCTURAL_FLEXIBILITY.name and hinged(one.parameters):
            joint = joint_of(robot, one)
            after = next_parallel(robot, joint)
            rows.append((index, joint, owners[index, FIRST_STATE], after))
    return np.array(rows, dtype=np.int64).reshape(-1, 4)


def _bends(robot: Robot, active: Sequence[ActiveEffect], hinges: IntArray) -> FloatArray:
    rows = np.zeros((len(hinges), 2))
    for row, (index, joint, _, after) in zip(rows, hinges, strict=True):
        place = float(active[index].parameters[4]) if after >= 0 else 0.0
        row[:] = place, usual_inertia(robot, int(joint), place)
    return rows


def _places(robot: Robot) -> list[tuple[int | None, int | None]]:
    """Where effects act: every cylinder, the whole robot, every joint without cylinder."""
    wet: list[tuple[int | None, int | None]] = [(i, None) for i in range(len(robot.cylinders))]
    return [*wet, (None, None), *((None, j) for j in robot.dry_joints)]


def _terms(
    active: Sequence[ActiveEffect], places: Sequence[tuple[int | None, int | None]]
) -> tuple[IntArray, IntArray]:
    rows: list[tuple[int, int, int]] = []
    spans = np.zeros((len(places), len(_STAGES), 2), dtype=np.int64)
    for place, wanted in enumerate(places):
        for code, stage in enumerate(_STAGES):
            start = len(rows)
            for index, one in enumerate(active):
                if (one.cylinder, one.joint) == wanted:
                    rows += _rows(one, index, stage)
            spans[place, code] = start, len(rows)
    return np.array(rows, dtype=np.int64).reshape(-1, 3), spans


def _commanded(
    active: Sequence[ActiveEffect], terms: IntArray, spans: IntArray, owners: IntArray, m: int
) -> tuple[IntArray, IntArray]:
    """Rows of `terms` that make, valve by valve, the states that follow from the commands alone.

    None of a valve one of whose effects looks at more, and none behind the last with states. And
    those states.
    """
    rows = np.zeros((m, 2), dtype=np.int64)
    known: list[int] = []
    for i in range(m):
        begin, end = spans[i, SIGNAL]
        effects = [int(e) for e in terms[begin:end, EFFECT]]
        if all(_of_command(active[e]) for e in effects):
            last = max((t for t, e in enumerate(effects) if owners[e, STATE_COUNT]), default=-1)
            rows[i] = begin, begin + last + 1
            for e in dict.fromkeys(effects):
                first = int(owners[e, FIRST_STATE])
                known += range(first, first + int(owners[e, STATE_COUNT]))
    return rows, np.array(known, dtype=np.int64)


def _of_command(one: ActiveEffect) -> bool:
    laws = [term.law for term in one.terms]
    laws += [state.rate for state in one.effect.states]
    alone = all(term.stage is Stage.SIGNAL for term in one.terms)
    return alone and all(signals_read(law) <= _OF_COMMAND for law in laws)


def _rows(one: ActiveEffect, index: int, stage: Stage) -> list[tuple[int, int, int]]:
    # States of a robot-wide effect follow the sum of all flows, known only after its laws ran.
    first = None if one.effect.robot_wide else one.terms[0]
    return [
        (law_address(term.law), index, int(term is first))
        for term in one.terms
        if term.stage is stage
    ]
