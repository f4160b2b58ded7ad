"""The compiled law against its readable twin, on random robots, states and references."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from hydro_control.gains import Gains
from hydro_control.law import law_reference
from hydro_control.law.law import ControlLaw
from hydro_control.law.law_arrays import law_arrays, law_work
from hydro_control.law.law_kernels import (
    ROWS,
    Required,
    flow_kernel,
    required_kernel,
    voltage_kernel,
)
from hydro_control.law.motion_kernels import damped_inverse_kernel, limit_notes
from hydro_control.motion.motion_limits import MotionLimits, limits_of
from hydro_control.motion.required_motion import (
    RANK_RATIO,
    JointMotion,
    Reference,
    damped_inverse,
    desired_at,
)
from hydro_control.state.axes import Axis, axes_of
from hydro_control.state.oil_columns import OilColumns
from hydro_control.state.state import State
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

CRANE = load_robot("xs031")
GAINS = Gains(k_p_1_s=12.0, k_v=7e3, k_x_m=0.02)


def _spatial(seed: int) -> Robot:
    """The crane with its second joint out of the plane and its valves in another order."""
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    tilted = replace(CRANE.joints[1], rotation=turn * np.sign(np.linalg.det(turn)))
    rough = tuple(replace(c, viscous_friction=3e4) for c in CRANE.cylinders)
    return replace(
        CRANE, joints=(CRANE.joints[0], tilted), cylinders=rough, valves=CRANE.valves[::-1]
    )


@dataclass(frozen=True)
class Setting:
    robot: Robot
    axes: tuple[Axis, ...]
    limits: MotionLimits
    arrays: Any
    work: Any


def setting(robot: Robot, tip_speed_m_s: float = 3.0) -> Setting:
    axes, limits = axes_of(robot), limits_of(robot, tip_speed_m_s)
    arrays = law_arrays(robot, axes, limits, GAINS, 0.002)
    return Setting(robot, axes, limits, arrays, law_work(arrays))


SETTINGS = {
    "crane": setting(CRANE),
    "slow tip": setting(CRANE, 0.2),
    "out of plane": setting(_spatial(3)),
}


def states(robot: Robot, count: int = 60) -> Iterator[tuple[State, np.random.Generator]]:
    """Anywhere within the limits and a little beyond, up to three times the speed limits."""
    rng = np.random.default_rng(11)
    lower = np.array([joint.lower for joint in robot.joints])
    upper = np.array([joint.upper for joint in robot.joints])
    speeds = np.array([joint.velocity_limit for joint in robot.joints])
    for k in range(count):
        q = lower + (upper - lower) * rng.uniform(-0.05, 1.05, len(lower))
        if k % 6 == 0:
            q[1] = 10.0 ** rng.uniform(-9.0, -2.0)  # stretched: nearly singular
        qd = speeds * rng.normal(size=len(q))
        pressures = rng.uniform(-1e5, 26e6, (2, len(robot.cylinders)))
        force = rng.normal(size=len(q)) * 1e5
        yield State(q, qd, force, pressures, rng.uniform(5e6, 21e6), rng.uniform(0.0, 1e6)), rng


def reference(robot: Robot, space: str, q: FloatArray, rng: np.random.Generator) -> Reference:
    away = rng.choice([1e-3, 0.05, 0.5])
    at = q if space == "joint" else np.asarray(tip_position(robot, q))
    size = len(at)
    of = (at + away * rng.normal(size=size), rng.normal(size=size) * away, rng.normal(size=size))
    return Reference(space, *of)  # type: ignore[arg-type]


def compiled(
    at: Setting, state: State, aim: Reference
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    rows, tip_d = np.empty((ROWS, at.robot.dof)), np.empty(3)
    given = np.array([aim.position, aim.velocity, aim.acceleration])
    when = state.q, state.qd, given, state.q, given
    found = required_kernel(at.arrays, at.work, aim.space == "tip", *when, rows, tip_d)
    return rows, tip_d, limit_notes(found)


def agree(found: FloatArray, expected: FloatArray, scale: float = 1.0) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11 * scale)


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("space", ["tip", "joint"])
def test_required_motion_and_force_are_those_of_the_equations(name: str, space: str) -> None:
    at = SETTINGS[name]
    said: set[str] = set()
    for state, rng in states(at.robot):
        aim = reference(at.robot, space, state.q, rng)
        rows, tip_d, notes = compiled(at, state, aim)
        expected, motion = law_reference.required(at.robot, at.axes, at.limits, GAINS, state, aim)
        assert notes == motion.notes
        said.update(notes)
        agree(tip_d, motion.tip_d_m)
        for field, found, wanted in zip(Required._fields, rows, expected, strict=True):
            # Near a singular pose the parts of a velocity cancel: its size is the limits'.
            scale = 1e6 if field == "force_d" else 100.0
            agree(found, np.asarray(wanted), scale)
    assert any("limit" in text for text in said)
    assert any("braking" in text for text in said)
    assert name != "slow tip" or any("tip speed" in text for text in said)
    planar = at.robot is CRANE
    assert space != "tip" or not planar or any("singular" in text for text in said)


@pytest.mark.parametrize("space", ["tip", "joint"])
def test_the_desired_motion_of_another_sample_takes_the_inverse_at_hand(space: str) -> None:
    """What is required is that of the state ahead, what is desired that of the sample."""
    at = SETTINGS["crane"]
    for state, rng in states(at.robot, 12):
        aim = reference(at.robot, space, state.q, rng)
        required, _, notes = compiled(at, state, aim)
        _, near = law_reference.required(at.robot, at.axes, at.limits, GAINS, state, aim)
        other = state.q + 1e-3
        own = replace(aim, position=aim.position + 2e-3, velocity=0.5 * aim.velocity)
        expected: JointMotion = desired_at(at.robot, other, own, near)
        tables = [np.array([r.position, r.velocity, r.acceleration]) for r in (aim, own)]
        when = state.q, state.qd, tables[0], other, tables[1]
        rows, tip_d = np.empty((ROWS, at.robot.dof)), np.empty(3)
        found = required_kernel(at.arrays, at.work, space == "tip", *when, rows, tip_d)
        agree(rows[0], expected.q_d, 100.0)
        agree(rows[1], expected.qd_d, 100.0)
        agree(tip_d, expected.tip_d_m)
        np.testing.assert_array_equal(rows[2:], required[2:])
        assert limit_notes(found) == notes


@pytest.mark.parametrize("name", SETTINGS)
def test_flows_openings_and_voltages_are_those_of_the_equations(name: str) -> None:
    at = SETTINGS[name]
    n, m = at.robot.dof, len(at.robot.valves)
    for k, (state, rng) in enumerate(states(at.robot)):
        aim = reference(at.robot, "joint", state.q, rng)
        rows, _, _ = compiled(at, state, aim)
        asked, leak = Required(*rows), rng.normal(size=n) * 1e-3
        columns = OilColumns(asked.length_a, asked.length_b, leak)
        rate = rng.normal(size=n) * 1e6
        flow, opening, voltage = np.empty(n), np.empty(n), np.zeros(m)
        flow_kernel(
            at.arrays,
            rows,
            state.force,
            rate,
            leak,
            state.pressures,
            state.p_s,
            state.p_t,
            flow,
            opening,
        )
        expected = law_reference.flow_term(at.axes, GAINS, state, asked, rate, columns)
        agree(flow, expected)
        agree(opening, law_reference.openings(at.axes, expected, columns, state))
        weak = replace(state, p_s=float(rng.uniform(0.5, 1.0)) * state.p_s)
        rails = weak.p_s, weak.p_t
        args = at.arrays, rows, state.force, rate, leak, state.pressures, *rails, flow, opening
        starved = flow_kernel(*args)
        agree(opening, law_reference.openings(at.axes, expected, columns, weak))
        assert bool(starved) == (not opening.all())
        signal = opening * rng.choice([0.01, 1.0]) if k % 2 else rng.uniform(-0.2, 0.2, n)
        before, most = rng.uniform(-10.0, 10.0, m), GAINS.slew_limit_v_s * 0.002
        voltage_kernel(at.arrays, signal, state.pressures, before, voltage)
        agree(
            voltage,
            law_reference.voltages(at.axes, at.limits, signal, state.pressures, before, most),
        )


@pytest.mark.parametrize("dof", [1, 2, 3, 6])
@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_the_damped_inverse_of_any_jacobian_is_that_of_its_singular_values(
    dof: int, rank: int
) -> None:
    rng = np.random.default_rng([dof, rank])
    for exponent in np.linspace(-12.0, 0.0, 30):
        shrink = np.diag([1.0, 10.0**exponent, 1.0][:rank])
        jacobian = rng.normal(size=(3, rank)) @ shrink @ rng.normal(size=(rank, dof))
        expected, damped = damped_inverse(jacobian)
        found, columns = np.empty((dof, 3)), np.empty((dof, 3))
        said = damped_inverse_kernel(jacobian, columns, np.empty((3, 3)), found)
        scale = max(1.0, float(np.abs(expected).max()))
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * scale)
        values = np.linalg.svd(jacobian, compute_uv=False)
        # The bound between a small singular value and none is no sharper than rounding.
        if not np.any(np.abs(values / max(values[0], 1e-300) / RANK_RATIO - 1.0) < 0.1):
            assert said == damped


@pytest.mark.parametrize("space", ["tip", "joint"])
def test_numbers_beyond_range_move_the_valves_within_limits_or_are_a_fault(space: str) -> None:
    law, still = ControlLaw(CRANE, Gains()), np.zeros(3 if space == "tip" else 2)
    pressures = np.full(2, 8e6)
    aim = Reference(space, still + 1e200, still + 1e300, still + 1e300)  # type: ignore[arg-type]
    q = np.array([0.6, -1.5])
    at_rest = Reference("joint", q, 0 * q, 0 * q)
    before = law.step(0.0, q, pressures, pressures, 19e6, 1e6, at_rest)
    answer = law.step(0.002, q, pressures, pressures, 19e6, 1e6, aim)
    most = Gains().slew_limit_v_s * law.dt_s
    assert np.all(np.abs(answer.voltage_v - before.voltage_v) <= most + 1e-12)
    huge = np.full(2, 1e308)
    answer = law.step(0.004, q, huge, -huge, 19e6, 1e6, aim)
    assert answer.fault
    assert not np.any(answer.voltage_v)


def test_any_layout_of_the_samples_gives_the_same_answer() -> None:
    """Rows of a table, columns of one and read-only arrays."""
    answers = []
    table = np.array([[0.6, -1.5], [8e6, 7e6], [6e6, 5e6], [0.61, -1.49]])
    frozen = table.copy()
    frozen.flags.writeable = False
    for columns in (table, frozen, np.asfortranarray(table)):
        law, still = ControlLaw(CRANE, Gains()), np.zeros(2)
        for k in range(3):
            q, p_a, p_b, wanted = columns
            aim = Reference("joint", wanted, still, still)
            answer = law.step(0.002 * k, q, p_a, p_b, 19e6, 1e6, aim)
        answers.append(answer.voltage_v.tolist())
    assert answers[0] == answers[1] == answers[2]
