"""Restrictions in series: each throttles what the others have left, and rails give what passes."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot import Robot
from hydro_model.simulation.simulate import Model, Rollout, simulate
from hydro_model.simulation.simulate_reference import reference_rates

#: A load-holding valve that stays shut, whatever the pressures.
SHUT = {"restriction": 0.5, "setting": 6e7, "range": 2e6, "pilot_ratio": 0.0}
#: One that lets 1 / sqrt(1 + (r u)^2) of the edge's flow pass.
OPEN = {"restriction": 2.0, "setting": 0.0, "range": 1e5, "pilot_ratio": 0.0}
CUSHION = {"strength": 0.9, "length": 0.2}
OUTFLOW = {"share": 0.0, "margin": 1e5, "outflow": 1.0}
HOSE = {"inertance": 2e7, "compliance": 1e-13, "damping": 0.3}
SUPPLY, TANK, P_A, P_B = 19e6, 1e6, 6e6, 9e6


def rates(robot: Robot, u: float, x: float) -> tuple[np.ndarray, Model]:
    """Rates of a piston at rest, as the compiled right-hand side has them and as the readable."""
    model = Model(robot)
    inputs = model.inputs([u], SUPPLY, TANK)
    state = model.rest([x], [0.0], [[P_A, P_B]], inputs)
    ours = model.rates(0.0, state, inputs)
    theirs = reference_rates(model.robot, model.active, 0.0, inputs, state, robot)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    return ours, model


@pytest.mark.parametrize("u", [0.5, -0.5])
@pytest.mark.parametrize(
    "others",
    [
        {"end_cushion": CUSHION},
        {"pressure_compensation": OUTFLOW},
        {"line_dynamics": HOSE},
        {"pressure_compensation": OUTFLOW, "line_dynamics": HOSE, "end_cushion": CUSHION},
    ],
)
def test_nothing_leaves_through_a_valve_that_is_shut(make_slider, others: dict, u: float) -> None:
    """Whatever else restricts the outflow, it cannot turn it round."""
    x = 0.5 if u > 0.0 else 0.1
    robot = make_slider(effects={**others, "counterbalance_valve": SHUT})
    rising, _ = rates(robot, u, x)
    assert rising[3 if u > 0.0 else 2] == pytest.approx(0.0, abs=1.0)
    free, _ = rates(make_slider(), u, x)
    assert free[3 if u > 0.0 else 2] < -1e9


@pytest.mark.parametrize("u", [0.5, -0.5])
def test_restrictions_in_series_multiply(make_slider, u: float) -> None:
    robot = make_slider()
    left = 0.05
    x = robot.cylinders[0].stroke_m - left if u > 0.0 else left
    at = 3 if u > 0.0 else 2
    free, _ = rates(robot, u, x)
    both, _ = rates(
        make_slider(effects={"counterbalance_valve": OPEN, "end_cushion": CUSHION}), u, x
    )
    passes = 1.0 / np.hypot(1.0, 2.0 * abs(u)) * (1.0 - 0.9 * (1.0 - left / 0.2))
    assert both[at] / free[at] == pytest.approx(passes, rel=1e-9)


def test_a_leak_past_the_piston_is_no_flow_of_the_valve(make_slider) -> None:
    """A shut valve holds back what would pass it, not what passes the piston's seal."""
    leak = {"internal_leakage": {"coefficient": 4e-12}}
    alone, _ = rates(make_slider(effects=leak), 0.0, 0.1)
    beside, _ = rates(make_slider(effects={**leak, "counterbalance_valve": SHUT}), -0.5, 0.1)
    assert beside[2] == pytest.approx(alone[2], rel=1e-9)
    assert beside[2] > 0.0


def run(robot: Robot, volts: float, x0: float) -> Rollout:
    times = np.arange(501) * 0.002
    return simulate(robot, times, np.full((len(times), 1), volts), [x0])


@pytest.mark.parametrize(("volts", "x0"), [(4.0, 0.1), (-4.0, 0.5)])
@pytest.mark.parametrize(
    "law",
    [
        {"pressure_compensation": {"share": 1.0, "margin": 7e5, "outflow": 1.0}},
        {"counterbalance_valve": {**OPEN, "restriction": 5.0}},
    ],
)
def test_rails_give_way_by_what_passes_the_valve(
    make_slider, law: dict, volts: float, x0: float
) -> None:
    """The supply gives what the piston makes room for, the tank takes what it drives out."""
    rails = {
        "supply_droop": {"resistance": 4e8, "time_constant": 0.02},
        "tank_back_pressure": {"resistance": 2e12, "time_constant": 0.02},
    }
    robot = make_slider(viscous_friction=2e4, effects={**rails, **law})
    out, c = run(robot, volts, x0), robot.cylinders[0]
    speed = out.qd[-1, 0]
    fed, emptied = (c.area_a_m2, c.area_b_m2) if volts > 0.0 else (c.area_b_m2, c.area_a_m2)
    assert abs(speed) > 1e-3
    assert SUPPLY - out.supply[-1] == pytest.approx(4e8 * fed * abs(speed), rel=2e-2)
    assert out.tank[-1] - TANK == pytest.approx(2e12 * (emptied * speed) ** 2, rel=4e-2)
    unheld = edge_flows(
        robot.valves[0], volts / 10.0, out.p_a[-1], out.p_b[-1], out.supply[-1], out.tank[-1]
    )
    assert max(np.abs(unheld).max() / abs(fed * speed), 1.0) > 1.5
