"""Sizes of effects at their operating points, and the intervals that stand beside figures."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_ident.study.hidden import Machine, Scene
from hydro_ident.study.intervals import Mean, Rate, mean, rate
from hydro_ident.study.planting import KNOWN, usual
from hydro_ident.study.sizes import READINGS, found_interval, found_size
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.mechanics import ABOUT
from hydro_model.robot import Robot

AT = {
    "lever": 0.3,
    "inertia_kg_m2": 2000.0,
    "fast_m_s": 0.1,
    "lowest_tip_m": -1.0,
    "duration_s": 60.0,
    "cycle_s": 0.002,
    "bulk_modulus_pa": 1e9,
    "line_volume_m3": 1e-4,
    "coldest_c": 30.0,
    "warmest_c": 38.0,
    "signal": 0.3,
    "other_rad_s": 0.5,
}


def test_mean_with_its_interval() -> None:
    assert mean([]) == Mean(None, 0, None)
    assert mean([2.0]).interval is None
    low, high = mean([1.0, 2.0, 3.0]).interval or (0.0, 0.0)
    assert 0.5 * (low + high) == pytest.approx(2.0)
    assert high - low == pytest.approx(2.0 * 4.302653 / 3.0**0.5)


def test_size_interval_follows_from_the_covariance() -> None:
    """Against draws of the parameters: a form of three, errors that hang together."""
    values = np.array([2000.0, 0.02, 1e-3])
    names = ["stribeck_friction." + n for n in ("force", "stribeck_velocity", "velocity_scale")]
    std = np.array([60.0, 1e-3])
    matrix = np.outer(std, std) * np.array([[1.0, -0.8], [-0.8, 1.0]])
    parameters = [
        {"name": n, "value": v, "std": s, "unit": ""}
        for n, v, s in zip(names, values.tolist(), [*std.tolist(), None], strict=True)
    ]
    covariance = {"names": names[:2], "values": matrix.tolist()}
    span = found_interval("stribeck_friction", parameters, AT, covariance)
    assert span is not None
    random, sizes = np.random.default_rng(2), []
    for draw in random.multivariate_normal(values[:2], matrix, 4000):
        changed = [{**p, "value": v} for p, v in zip(parameters, [*draw, 1e-3], strict=True)]
        sizes.append(found_size("stribeck_friction", changed, AT))
    assert 0.5 * (span[1] - span[0]) == pytest.approx(1.96 * np.std(sizes), rel=0.06)
    apart = found_interval("stribeck_friction", parameters, AT)
    assert apart is not None
    assert abs((apart[1] - apart[0]) / (span[1] - span[0]) - 1.0) > 0.02
    bare = [{**p, "std": None} for p in parameters]
    assert found_interval("stribeck_friction", bare, AT) is None


@pytest.mark.parametrize(("hits", "of"), [(0, 300), (3, 300), (150, 300), (300, 300)])
def test_intervals_cover_what_they_should(hits: int, of: int) -> None:
    from scipy.stats import binom

    low, high = Rate(hits, of).interval
    assert low <= hits / of <= high
    if hits > 0:
        assert binom.sf(hits - 1, of, low) == pytest.approx(0.025, rel=1e-6)
    if hits < of:
        assert binom.cdf(hits, of, high) == pytest.approx(0.025, rel=1e-6)
    assert rate([]).share is None
    assert rate([]).interval == (0.0, 1.0)


def test_sizes_read_the_catalogue_parameters() -> None:
    """Every reading takes parameters that the catalogue has, and gives a finite size of them."""
    for name in READINGS:
        effect = CATALOGUE[name]
        # Where it acts: about a joint a spring has no size with the rod in.
        own = [(p.name, 0.0 if p is ABOUT else p.typical) for p in effect.parameters]
        parameters = [{"name": f"{name}.{n}", "value": value} for n, value in own]
        size = found_size(name, parameters, AT)
        assert size is not None, name
        assert np.isfinite(size), name
    assert set(READINGS) <= set(KNOWN)
    assert found_size("cavitation", [], AT) is None
    assert found_size("coulomb_friction", [], AT) == 0.0
    assert found_size("pin_friction", [], AT) is None


@pytest.mark.parametrize("fast", [0.05, 0.1, 0.4])
def test_quadratic_friction_is_stated_where_both_laws_agree(fast: float, robot: Robot) -> None:
    """A square law beside a line, fitted to the truth's up to the fast speed, has its size."""
    time = np.linspace(0.0, 60.0, 601)
    stroke = 0.5 + (fast / 0.2) * np.sin(0.2 * time)[:, None] * np.ones(2)
    scene = Scene(60.0, stroke, stroke, stroke, stroke, time, np.ones(2))
    plain = Machine(robot, plain_truth(robot, 1), None, True)
    hidden = KNOWN["quadratic_friction"]
    machine = hidden.apply(plain, scene, 0, 300.0, 1)
    speed = np.linspace(0.0, scene.fast_m_s(0), 200)
    force = machine.truth.extras.axes[0].turbulent * speed**1.75
    columns = np.stack([speed**2, speed], axis=1)
    coefficient = float(np.linalg.lstsq(columns, force, rcond=None)[0][0])
    found = [{"name": "quadratic_friction.coefficient", "value": coefficient}]
    at = AT | {"fast_m_s": scene.fast_m_s(0)}
    assert found_size("quadratic_friction", found, at) == pytest.approx(300.0, rel=0.02)


@pytest.mark.parametrize("largest", [0.1, 0.4, 0.9])
@pytest.mark.parametrize("seed", range(4))
def test_a_bent_valve_is_stated_where_it_is_seen(largest: float, seed: int, robot: Robot) -> None:
    """Our form beside a gain, fitted to the truth's up to some signal, has the truth's size."""
    signal = largest * np.sin(np.linspace(0.0, 2.0 * np.pi, 401))
    scene = Scene(60.0, *[np.zeros((1, 2))] * 4, np.zeros(1), np.ones(2))
    plain = Machine(robot, plain_truth(robot, 1), None, True)
    size = 0.12
    machine = KNOWN["valve_gain_nonlinearity"].apply(plain, scene, 0, size, seed)
    bend = machine.truth.extras.axes[0].bend
    opening = signal * (1.0 + bend) / (1.0 + bend * abs(signal))
    # Opening = g u + h u |u|: our form, times a gain that the edges take up.
    g, h = np.linalg.lstsq(np.stack([signal, signal * abs(signal)], 1), opening, rcond=None)[0]
    found = [{"name": "valve_gain_nonlinearity.progression", "value": float(h / (g + h))}]
    at = AT | {"signal": usual(signal)}
    assert found_size("valve_gain_nonlinearity", found, at) == pytest.approx(size, rel=0.03)


def test_a_coupling_is_stated_at_the_rate_that_is_seen(robot: Robot) -> None:
    rate = 0.9 * np.sin(np.linspace(0.0, 2.0 * np.pi, 401))
    scene = Scene(60.0, *[np.full((1, 2), 0.3)] * 4, np.zeros(1), np.ones(2))
    plain = Machine(robot, plain_truth(robot, 1), None, True)
    machine = KNOWN["joint_coupling"].apply(plain, scene, 0, 800.0, 1)
    torque = machine.truth.extras.axes[0].coupling * rate / np.hypot(1.0, rate)
    viscous = float(rate @ torque / (rate @ rate))
    found = [{"name": "joint_coupling.viscous", "value": viscous}]
    at = AT | {"lever": 0.3, "other_rad_s": usual(rate)}
    assert found_size("joint_coupling", found, at) == pytest.approx(800.0, rel=0.02)


def test_every_name_of_the_catalogue_has_a_truth() -> None:
    """No machine of the study comes near cavitation, and all of them have cylinders."""
    drives = {name for name, effect in CATALOGUE.items() if effect.drive_only}
    assert set(CATALOGUE) - set(KNOWN) == {"cavitation"} | drives
    assert set(KNOWN) <= set(CATALOGUE)
