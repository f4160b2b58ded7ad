"""The signature of each effect over a recording and in a roll-out, where the truth is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq
from scipy.signal import lti, step

from hydro_model.effects import CATALOGUE, Stage
from hydro_model.effects import signals as sig
from hydro_model.effects.rows import signal_rows
from hydro_model.hydraulics.valve import signed_root
from hydro_model.robot import EffectSpec, Robot
from hydro_model.simulation.simulate import Rollout, simulate

STEP = 0.002
FAST = 2e4  # viscous friction that keeps the slider calm, N s/m


def rows(count: int, **columns: np.ndarray | float) -> np.ndarray:
    """Signals over a recording: zero but for those given by name."""
    s = np.zeros((count, sig.SIGNAL_COUNT))
    s[:, sig.LEVER] = 1.0
    for name, values in columns.items():
        s[:, getattr(sig, name.upper())] = values
    return s


def drive(robot: Robot, volts: np.ndarray | float, seconds: float, **options: object) -> Rollout:
    times = np.arange(round(seconds / STEP) + 1) * STEP
    table = np.broadcast_to(np.asarray(volts, float).reshape(-1, 1), (len(times), 1))
    return simulate(robot, times, table, **{"q0": [0.2], **options})


def dry(robot: Robot, *specs: tuple[str, dict[str, float]]) -> Robot:
    """The slider without its cylinder, with effects on its joint."""
    listed = [EffectSpec(name, robot.name, values) for name, values in specs]
    friction = robot.cylinders[0].viscous_friction
    joint = replace(robot.joints[0], viscous_friction=friction)
    return replace(robot, joints=(joint,), cylinders=(), valves=(), effects=tuple(listed))


def push(robot: Robot, force: np.ndarray | float, seconds: float, q0: float = 0.2) -> Rollout:
    times = np.arange(round(seconds / STEP) + 1) * STEP
    table = np.broadcast_to(np.asarray(force, float).reshape(-1, 1), (len(times), 1))
    return simulate(robot, times, np.zeros((len(times), 0)), [q0], torque=table)


# Friction --------------------------------------------------------------------------------------


def test_bristle_bends_over_its_distance_and_then_slides() -> None:
    v, d = 1e-3, 2e-4
    s = rows(500, piston_velocity=v)
    force = CATALOGUE["presliding_friction"].evaluate(s, [3e3, d], sample_time_s=STEP)
    travel = np.arange(500) * STEP * v
    np.testing.assert_allclose(force, 3e3 * (1.0 - np.exp(-travel / d)), rtol=1e-4)


def test_bristle_at_rest_holds_a_load_below_its_force(make_slider) -> None:
    """Stuck: the load bends the bristle and is then carried at rest."""
    effects = ("presliding_friction", {"force": 3e3, "distance": 2e-4})
    out = push(dry(make_slider(viscous_friction=FAST), effects), 2000.0, 4.0)
    stuck = out.q[-1, 0] - 0.2
    assert abs(out.qd[-1, 0]) < 1e-5
    # Dahl: F = Fc (1 - exp(-x / d)) on the first bend; it rings once undamped, so no further.
    assert 2e-4 * np.log(3.0) * 0.5 < stuck < 1e-3
    assert out.q[-500:, 0].std() < 1e-6


def test_bristle_integration_stays_stable_at_any_speed() -> None:
    s = rows(200, piston_velocity=3.0)
    force = CATALOGUE["presliding_friction"].evaluate(s, [1.0, 2e-5], sample_time_s=0.02)
    assert force[1:] == pytest.approx(1.0, rel=1e-6)


def test_states_survive_a_gap_in_the_recording() -> None:
    v = np.full(300, 1e-2)
    v[:5] = v[100:120] = np.nan
    law = CATALOGUE["presliding_friction"]
    force = law.evaluate(rows(300, piston_velocity=v), [3e3, 2e-4], sample_time_s=STEP)
    assert force[:6] == pytest.approx(0.0)
    assert force[95:] == pytest.approx(3e3, rel=1e-3)


def test_drift_halves_the_viscous_friction_per_halving_temperature() -> None:
    drift, v = CATALOGUE["temperature_drift"], 0.2
    values = [2e4, 17.5, 30.0, 100.0, 40.0, 0.0]
    warm = drift.evaluate(rows(3, piston_velocity=v, oil_temperature=57.5), values)
    assert warm + 2e4 * v == pytest.approx(1e4 * v)
    cold = drift.evaluate(rows(3, piston_velocity=v, oil_temperature=22.5), values)
    assert cold + 2e4 * v == pytest.approx(4e4 * v)
    times = np.array([0.0, 100.0, 1e5])
    by_time = drift.evaluate(
        rows(3, piston_velocity=v, oil_temperature=np.nan, time=times), values
    )
    degrees = 30.0 * (1.0 - np.exp(-times / 100.0))
    np.testing.assert_allclose(by_time, 2e4 * v * (2.0 ** (-degrees / 17.5) - 1.0))
    later = rows(3, piston_velocity=v, oil_temperature=np.nan, time=times - 60.0 * (times > 0.0))
    warm = drift.evaluate(later, [*values[:-1], 60.0])
    np.testing.assert_allclose(warm[1:], by_time[1:])


def test_pins_rub_more_at_a_small_lever_and_never_drive() -> None:
    pins = CATALOGUE["pin_friction"]
    for lever in (0.1, 0.3, -0.3):
        s = rows(1, lever=lever, piston_force=-5e4, joint_velocity=1.0, piston_velocity=lever)
        force = pins.evaluate(s, [1.5e-3, 1e-3, 0.0], sample_time_s=STEP)
        assert force == pytest.approx(1.5e-3 * 5e4 / lever)
        assert force * lever > 0.0  # takes power
        # Bent bristles carry the same, whatever side the lever is on.
        bent = pins.evaluate(np.repeat(s, 50, axis=0), [1.5e-3, 1e-3, 1e-4], sample_time_s=STEP)
        assert bent[-1] == pytest.approx(float(force[0]))


# Mechanics -------------------------------------------------------------------------------------


def test_structure_carries_its_share_of_the_mass_and_rings_at_its_mode(make_slider) -> None:
    """A force step: the whole mass gains F t / M; the joint rings free-free around that."""
    mode = ("structural_flexibility", {"inertia": 300.0, "frequency": 5.0, "damping": 0.0})
    out = push(dry(make_slider(), mode), 100.0, 1.0)
    t, bend, sprung = out.time_s, out.effect_states[:, 0], out.effect_states[:, 1]
    momentum = 700.0 * out.qd[:, 0] + 300.0 * sprung
    np.testing.assert_allclose(momentum, 100.0 * t, atol=1e-3)
    omega = 2.0 * np.pi * 5.0 * np.sqrt(1000.0 / 700.0)
    static = -100.0 / 700.0 / omega**2
    np.testing.assert_allclose(bend, static * (1.0 - np.cos(omega * t)), atol=1e-3 * abs(static))


def play_flow(force: np.ndarray, stage: Stage, parameters: list[float], fine: int) -> np.ndarray:
    """Flow into a chamber by a play of 0.3 mm, m^3/s, in `fine` steps per sample."""
    s = rows(force.size, piston_force=force, piston_velocity=0.0, area_a=5e-3, area_b=3.4e-3)
    play = CATALOGUE["backlash"]
    return play.evaluate(np.repeat(s, fine, axis=0), [3e-4, *parameters], stage, STEP / fine)


def test_play_moves_the_volume_of_its_width_when_the_load_turns() -> None:
    force = np.where(np.arange(400) < 100, 2e4, -2e4)
    for stage, area in ((Stage.FLOW_A, 5e-3), (Stage.FLOW_B, -3.4e-3)):
        flow = play_flow(force, stage, [300.0, 0.0, 0.0], 16)
        assert flow.sum() * STEP / 16 == pytest.approx(area * 3e-4, rel=2e-2)
        assert np.abs(flow[: 99 * 16]).max() < 1e-15


def test_play_is_crossed_while_no_force_goes_through_the_pin() -> None:
    """As by a load whose missing force grows evenly: as the third power of time."""
    at = np.arange(400)
    force = np.where(at < 100, 2e4, np.where(at < 200, 0.0, -2e4))
    crossed = np.cumsum(play_flow(force, Stage.FLOW_A, [300.0, 0.0, 0.0], 16)) * STEP / 16
    gone = np.clip((np.arange(400 * 16) / 16 - 100.0) / 100.0, 0.0, 1.0)
    np.testing.assert_allclose(crossed, 5e-3 * 3e-4 * gone**3, atol=2e-3 * 5e-3 * 3e-4)


def test_tip_rests_on_the_ground_and_bounces_without_loss(make_slider) -> None:
    ground = ("external_contact", {"stiffness": 1e6, "height": 0.2})
    robot = dry(make_slider(gravity=9.81), ground)
    sunk = 0.2 - 1000.0 * 9.81 / 1e6
    np.testing.assert_allclose(push(robot, 0.0, 0.2, sunk).q, sunk, atol=1e-9)
    out = push(robot, 0.0, 0.5, 0.25)
    assert out.q[:, 0].min() < 0.2
    depth = np.maximum(0.2 - out.q[:, 0], 0.0)
    energy = 500.0 * out.qd[:, 0] ** 2 + 9810.0 * out.q[:, 0] + 0.5e6 * depth**2
    np.testing.assert_allclose(energy, energy[0], rtol=2e-4)


def test_spring_balances_a_load(make_slider) -> None:
    spring = ("counterbalance_spring", {"force": -2e3, "stiffness": 5e3})
    robot = dry(make_slider(), spring)
    np.testing.assert_allclose(push(robot, 0.0, 0.2, 0.4).q, 0.4, atol=1e-9)
    out = push(robot, 0.0, 1.0, 0.3)
    omega = np.sqrt(5e3 / 1000.0)
    np.testing.assert_allclose(out.q[:, 0], 0.4 - 0.1 * np.cos(omega * out.time_s), atol=1e-6)


def test_coupling_follows_the_other_joint_with_or_without_its_acceleration() -> None:
    coupling, t = CATALOGUE["joint_coupling"], np.arange(2000) * STEP
    position, rate = 0.1 * np.sin(t), 0.1 * np.cos(t)
    motion = {"other_position": position, "other_velocity": rate, "lever": 0.25}
    expected = (500.0 * rate - 100.0 * position + 200.0 * position) / 0.25
    known = rows(2000, **motion, other_acceleration=-position)
    blind = rows(2000, **motion, other_acceleration=np.nan)
    values = [500.0, 100.0, 200.0]
    np.testing.assert_allclose(coupling.evaluate(known, values, sample_time_s=STEP), expected)
    late = coupling.evaluate(blind, values, sample_time_s=STEP)[50:]
    np.testing.assert_allclose(late, expected[50:], atol=0.02 * 100.0 * 0.1 / 0.25 + 0.5)


# Valve, lines and chambers ---------------------------------------------------------------------


def test_hysteresis_is_a_play() -> None:
    t = np.arange(2000) * STEP
    u = 0.1 * np.abs((t / 2.0 + 0.5) % 1.0 - 0.5) * 4.0 - 0.1  # a triangle between -0.1 and 0.1
    s = rows(2000, valve_signal=u)
    out = CATALOGUE["valve_hysteresis"].evaluate(s, [0.01, 5e-4, 0.0], sample_time_s=STEP)
    rising = np.gradient(u) > 0.0
    settled = (np.abs(u) < 0.075) & (t > 1.2)
    np.testing.assert_allclose((out - u)[settled & rising], -0.01, atol=5e-4)
    np.testing.assert_allclose((out - u)[settled & ~rising], 0.01, atol=5e-4)


def test_hysteresis_with_travel_follows_dahls_branches() -> None:
    """After a reversal the distance to the other branch falls by e per 2 h + l of the command."""
    half, travel = 0.004, 0.03
    u = np.concatenate([np.linspace(0.0, 0.3, 3001), np.linspace(0.3, 0.0, 3001)[1:]])
    s = rows(len(u), valve_signal=u)
    out = CATALOGUE["valve_hysteresis"].evaluate(s, [half, 1e-4, travel], sample_time_s=STEP)
    way, scale = np.abs(u - 0.3)[3000:], 2.0 * half + travel
    up = half * (1.0 - math.exp(-0.3 / scale))
    behind = -half + (up + half) * np.exp(-way / scale)
    # It answers a command when that is held for a cycle, twenty time constants.
    np.testing.assert_allclose(u[3000:-1] - out[3001:], behind[:-1], atol=1e-9)
    # The spool stands where the command turns: no branch runs against it.
    assert (np.diff(out[3001:]) <= 1e-9).all()


def test_underlap_at_null_divides_the_supply_by_the_edges(make_slider) -> None:
    lap = {"valve_underlap": {"width": 0.02}}
    out = drive(make_slider(mass_kg=1e15, effects=lap), 0.0, 2.0, p0=[[3e6, 3e6]])
    for pressure, inwards, outwards in ((out.p_a, 9e-7, 8e-7), (out.p_b, 7e-7, 6e-7)):
        share = inwards**2 / (inwards**2 + outwards**2)
        assert pressure[-1, 0] == pytest.approx(1e6 + share * 18e6, rel=1e-3)


def test_compensated_speed_does_not_depend_on_the_load(make_slider) -> None:
    effects = {"pressure_compensation": {"margin": 7e5}}
    robot = make_slider(viscous_friction=FAST, effects=effects)
    area = robot.cylinders[0].area_a_m2
    for load in (0.0, -2e4):
        times = np.arange(601) * STEP
        torque = np.full((601, 1), load)
        out = simulate(robot, times, np.full((601, 1), 3.0), [0.1], torque=torque)
        expected = 9e-7 * 0.3 * float(signed_root(7e5)) / area
        assert out.qd[-1, 0] == pytest.approx(expected, rel=5e-3)


def test_compensated_outflow_does_not_depend_on_the_load_either(make_slider) -> None:
    """Lowered by a compensated edge to tank a heavier load is no faster."""
    effects = {"pressure_compensation": {"share": 0.0, "margin": 7e5, "outflow": 1.0}}
    robot = make_slider(viscous_friction=FAST, effects=effects)
    area = robot.cylinders[0].area_a_m2
    for load in (-1e4, -2e4):
        times = np.arange(601) * STEP
        torque = np.full((601, 1), load)
        out = simulate(robot, times, np.full((601, 1), -3.0), [0.4], torque=torque)
        expected = -8e-7 * 0.3 * float(signed_root(7e5)) / area
        assert out.qd[-1, 0] == pytest.approx(expected, rel=5e-3)


def test_counterbalance_valve_holds_a_load_until_it_is_piloted(make_slider) -> None:
    opens = {"restriction": 0.5, "setting": 8e6, "range": 2e6, "pilot_ratio": 3.0}
    hold = EffectSpec("counterbalance_valve", "ram/a", opens)
    robot = replace(make_slider(viscous_friction=FAST, gravity=9.81), effects=(hold,))
    robot = replace(robot, supply_pressure_pa=1.2e6)  # no pilot pressure to be had
    still = drive(robot, -3.0, 1.0, p0=[[2.5e6, 1e6]])
    plain = drive(replace(robot, effects=()), -3.0, 1.0, p0=[[2.5e6, 1e6]])
    assert abs(still.q[-1, 0] - 0.2) < 1e-3
    assert plain.q[-1, 0] < 0.15
    piloted = drive(replace(robot, supply_pressure_pa=19e6), -3.0, 0.5, p0=[[2.5e6, 1e6]])
    assert piloted.qd[-1, 0] < -0.02


def test_cushion_slows_the_piston_into_the_end_but_not_out_of_it(make_slider) -> None:
    effects = {"end_cushion": {"strength": 0.9, "length": 0.05}}
    robot, plain = (make_slider(viscous_friction=FAST, effects=e) for e in (effects, {}))
    into, free = (drive(r, -2.0, 0.9, q0=[0.1]) for r in (robot, plain))
    early = into.q[:, 0] > 0.06
    np.testing.assert_allclose(into.q[early], free.q[early], atol=1e-6)
    assert abs(into.qd[-1, 0]) < 0.7 * abs(free.qd[-1, 0])
    out, other = (drive(r, 2.0, 0.3, q0=[0.02]) for r in (robot, plain))
    np.testing.assert_allclose(out.q, other.q, atol=1e-6)


#: Parts of a sample that a mean over it is taken of.
_FINE = 50


def test_line_passes_flow_on_as_the_second_order_system() -> None:
    s = rows(200)
    s[1:, sig.VALVE_FLOW_A] = 1e-4
    law = CATALOGUE["line_dynamics"]
    omega, inertance = 2.0 * np.pi * 40.0, 1.0e6
    hose = [inertance, 1.0 / (inertance * omega**2), 0.3, 0.0]
    s[:, sig.SUPPLY_PRESSURE] = 1.0e15  # no pressure of the hose's changes the edge's flow
    lag = law.evaluate(s, hose, Stage.FLOW_A, STEP)
    fine = np.arange(199 * _FINE + 1) * STEP / _FINE
    _, response = step(lti([1e-4 * omega**2], [1.0, 0.6 * omega, omega**2]), T=fine)
    # Means over the samples, of a mode that swings within them.
    whole = cumulative_trapezoid(response, fine, initial=0.0)[::_FINE]
    expected = np.diff(whole) / STEP
    np.testing.assert_allclose((lag + s[:, sig.VALVE_FLOW_A])[1:], expected, atol=1e-8)
    assert not law.evaluate(s, hose, Stage.FLOW_B, STEP).any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_moving_a_hoses_oil_takes_from_the_drop_at_the_edge(sign: float) -> None:
    """A ramp of flow, once the mode has settled: the edge's own law at the raised pressure."""
    s, rate, inertance = rows(500), 2.0e-3, 3.0e7
    s[:, sig.VALVE_FLOW_A] = sign * (1e-4 + rate * STEP * np.arange(500))
    s[:, sig.SUPPLY_PRESSURE], s[:, sig.PRESSURE_A] = 2.0e7, 1.0e7
    s[:, sig.TANK_PRESSURE] = 0.0
    hose, law = [inertance, 1.0e-14, 0.7, 0.0], CATALOGUE["line_dynamics"]
    change = law.evaluate(s, hose, Stage.FLOW_A, STEP)[-1]
    flow = s[-1, sig.VALVE_FLOW_A]
    s[:, [sig.SUPPLY_PRESSURE, sig.TANK_PRESSURE]] = 1.0e15, -1.0e15
    lag = law.evaluate(s, hose, Stage.FLOW_A, STEP)[-1]
    # In either direction oil that is to be moved faster pushes back at the valve.
    exact = flow * np.sqrt(1.0 - inertance * rate / 1.0e7) - flow
    assert change - lag == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_hose_that_resists_takes_what_its_own_flow_loses(sign: float) -> None:
    """Steady flow through edge and hose in series, as scipy solves it."""
    s, resistance, drop = rows(500), 5.0e9, 1.0e7
    s[:, sig.VALVE_FLOW_A] = flow = sign * 4e-4
    s[:, sig.SUPPLY_PRESSURE], s[:, sig.PRESSURE_A] = 2.0e7, 1.0e7
    change = CATALOGUE["line_dynamics"].evaluate(
        s, [1.0e6, 1.0e-14, 0.7, resistance], Stage.FLOW_A, STEP
    )[-1]
    edge = 4e-4 / np.sqrt(drop)
    through = brentq(lambda q: q - edge * np.sqrt(drop - resistance * q), 0.0, 4e-4)
    assert through < 0.92 * 4e-4
    assert flow + change == pytest.approx(sign * through, rel=1e-6)


def test_cavity_holds_the_pressure_up_and_collapses_again(make_slider) -> None:
    """A load that pulls with closed valves: without cavity the model goes far below vacuum."""
    cavity = {"cavitation": {"pressure": 2e4}}
    times = np.arange(601) * STEP
    pull = np.where(times < 0.3, 6e4, 0.0)[:, None]
    runs = [
        simulate(
            make_slider(viscous_friction=FAST, effects=effects),
            times,
            np.zeros((601, 1)),
            [0.2],
            p0=[[1e6, 1e6]],
            torque=pull,
        )
        for effects in ({}, cavity)
    ]
    absolute = [run.p_a[:, 0] + 101325.0 for run in runs]
    assert absolute[0].min() < -5e5
    assert absolute[1].min() > -1e4
    gas = runs[1].effect_states
    assert gas[:, 0].max() > 1e-6
    assert gas[-1] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert absolute[1][-1] > 5e5
    # Oil and gas fill what the piston leaves: V = V0 exp(-(p - p0) / beta) + gas.
    volume = runs[1].q[:, 0] * runs[1].q.shape[1] * 0.0050265
    oil = 0.2 * 0.0050265 * np.exp(-(runs[1].p_a[:, 0] - 1e6) / 1.2e9)
    np.testing.assert_allclose(volume - oil, gas[:, 0], atol=2e-6)


# Rows ------------------------------------------------------------------------------------------


def test_rows_of_a_recording_are_what_a_roll_out_sees(make_slider) -> None:
    robot = make_slider(viscous_friction=FAST)
    out = drive(robot, 3.0, 0.2)
    pressures = np.column_stack([out.p_a, out.p_b, out.supply, out.tank])
    opening = out.valve_signal[:, 0]
    s = signal_rows(robot, 0, 0, out.time_s, out.q, out.qd, None, pressures, opening)
    np.testing.assert_allclose(s[:, sig.PISTON_FORCE], out.piston_force[:, 0])
    np.testing.assert_allclose(s[:, sig.PISTON_VELOCITY], out.qd[:, 0])
    np.testing.assert_allclose(s[:, sig.TIP_HEIGHT], 0.0, atol=1e-12)  # it slides level
    balance = s[:, sig.VALVE_FLOW_A] - s[:, sig.AREA_A] * s[:, sig.PISTON_VELOCITY]
    rise = balance * 1.2e9 / (s[:, sig.AREA_A] * s[:, sig.PISTON_POSITION])
    np.testing.assert_allclose(
        np.gradient(out.p_a[:, 0], STEP)[5:-5], rise[5:-5], rtol=0.05, atol=2e6
    )
    assert np.isnan(s[:, [sig.OTHER_POSITION, sig.OIL_TEMPERATURE, sig.SUPPLY_FLOW]]).all()
