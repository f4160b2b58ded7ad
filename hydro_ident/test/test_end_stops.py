"""A piston that is pressed against its stop: what the stop bears is no load of the machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.forces.end_stops import at_end_stops
from hydro_ident.estimate.forces.force_rows import force_rows
from hydro_ident.estimate.forces.inertial import fit_inertial, force_model
from hydro_ident.estimate.forces.late_forces import late_rows
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import FilterSettings, central_differences
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.laying import material_of
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Robot

H, SECONDS = 0.002, 40.0


def _pressed(robot: Robot, push_n: float, shift: float = 0.0) -> Trace:
    """The crane in exact motion, its lift pushed for two seconds against the retracted stop."""
    time = np.arange(0.0, SECONDS, H)
    lift = robot.cylinders[0]
    low, high = robot.joints[0].lower, robot.joints[0].upper
    grid = np.linspace(low, high, 4001)
    end = float(grid[np.argmin(np.abs(stroke(lift, grid) - shift))])
    inside = end + 0.4 * np.sign(0.5 * (low + high) - end)
    ramp = np.clip(np.minimum(time - 18.0, 24.0 - time) / 2.0, 0.0, 1.0)
    down = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    swing = 0.2 * np.sin(2.0 * time) + 0.1 * np.sin(3.7 * time)
    q = np.stack(
        [
            inside + (1.0 - down) * swing + down * (end - inside),
            -1.2 + 0.3 * np.sin(1.7 * time) + 0.15 * np.sin(4.1 * time),
        ],
        axis=1,
    )
    qd, qdd = central_differences(q, H)
    torque = inverse_dynamics(robot, q, qd, qdd)
    p_a, strokes = np.zeros_like(q), np.zeros_like(q)
    for i, c in enumerate(robot.cylinders):
        arm, strokes[:, i] = lever(c, q[:, i]), stroke(c, q[:, i])
        force = torque[:, i] / arm + c.viscous_friction * arm * qd[:, i]
        if i == 0:
            force = force + push_n * (ramp >= 1.0)
        p_a[:, i] = force / c.area_a_m2
    still, rails = np.zeros_like(q), np.zeros(time.size)
    return Trace(
        "bag#0", H, time, q, strokes, p_a, still, rails + 1.8e7, rails, still, still * np.nan
    )


@pytest.mark.parametrize("push_n", [0.0, -8e4])
def test_what_a_stop_bears_is_no_mass(robot: Robot, push_n: float) -> None:
    trace = _pressed(robot, push_n)
    model = force_model(robot)
    fit = fit_inertial(model, [trace])
    assert fit is not None
    truth = model.base.combination @ robot.parameter_vector
    size = np.abs(truth).max()
    assert fit.fit.theta[: truth.size] == pytest.approx(truth, abs=2e-3 * size)


def test_rows_within_the_filters_reach_of_a_stop_are_left_out(robot: Robot) -> None:
    trace, settings = _pressed(robot, 0.0), FilterSettings()
    mask = at_end_stops(robot, trace, settings)
    stopped = trace.time_s[mask[:, 0]]
    reach = settings.edge_samples(H) * H
    assert stopped[0] == pytest.approx(20.0 - reach, abs=0.3)
    assert stopped[-1] == pytest.approx(22.0 + reach, abs=0.3)
    model = force_model(robot)
    rows = force_rows(model, trace, settings)
    assert rows is not None
    assert np.isnan(rows.y[np.isin(rows.time_s, stopped), 0]).all()
    # The stop of one joint bears nothing in the equation of another.
    assert not mask[:, 1].any()
    assert np.isfinite(rows.y[:, 1]).all()
    assert np.isfinite(rows.y[:, 0]).mean() > 0.8
    assert len(late_rows(model, trace, rows, settings).y) == len(rows.y)
    # What never moves would leave nothing of what does.
    assert not at_end_stops(robot, trace, settings, still=(0,)).any()


def test_a_diagnosis_lays_no_row_that_a_stop_bears(robot: Robot) -> None:
    """Neither to fit nor to verify on; what its valve passes stays, and the other joint."""
    trace, filters = _pressed(robot, -8e4), FilterSettings()
    material = material_of(robot, force_model(robot), [trace], filters, WindowSettings(), {})
    fit, score = material.masks(HoldOut.of({"bag": SECONDS}))
    assert not ((fit | score) & material.stopped).any()
    held = {material.channels[k] for k in np.unique(material.channel[material.stopped])}
    assert held == {"lift/force"}
    times = material.time_s[material.stopped]
    assert 2.0 < np.ptp(times) < 4.0
    assert 20.0 < times.mean() < 22.0


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_of_a_few_samples_nothing_is_told(robot: Robot, samples: int) -> None:
    """Between two losses; as near to the stop as the others."""
    trace = _pressed(robot, 0.0)
    at = slice(10500, 10500 + samples)
    few = replace(
        trace,
        **{n: getattr(trace, n)[at] for n in ("time_s", "q", "stroke", "p_a", "p_b", "supply")},
    )
    assert not at_end_stops(robot, few, FilterSettings()).any()
    assert at_end_stops(robot, trace, FilterSettings())[at, 0].all()


def test_a_rest_elsewhere_is_none(robot: Robot) -> None:
    trace = _pressed(robot, 0.0, shift=0.05)
    assert not at_end_stops(robot, trace, FilterSettings()).any()


def test_what_goes_on_beyond_a_limit_has_met_no_stop(robot: Robot) -> None:
    """A limit of the file that is not the machine's: a rest behind it is one like any other."""
    trace, joint = _pressed(robot, 0.0), robot.joints[0]
    inside = replace(joint, upper=float(trace.q[:, 0].max()) - 0.05, lower=-3.0)
    wide = tuple(replace(c, stroke_m=c.stroke_m + 1.0) for c in robot.cylinders)
    other = replace(robot, joints=(inside, robot.joints[1]), cylinders=wide)
    far = replace(trace, stroke=trace.stroke + 0.5)
    assert not at_end_stops(other, far, FilterSettings())[:, 0].any()
