"""The rule that chooses an estimator, and that they agree on good data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.identify.identification import Identification, Settings, identify
from hydro_ident.study.synthetic import Noise, synthetic_recording
from hydro_model.multibody.base_parameters import base_map
from hydro_model.robot import Robot

pytestmark = pytest.mark.needs("clarabel")


@pytest.fixture(scope="module")
def quiet() -> Identification:
    return _identified(Noise())


def _identified(noise: Noise, **settings: object) -> Identification:
    from hydro_model.robot_files import load_robot

    robot = load_robot("xs031")
    recording = synthetic_recording(robot, 20.0, 1, noise)
    return identify(robot, [recording], settings=Settings(**settings))  # type: ignore[arg-type]


def _errors(robot: Robot, found: Identification) -> np.ndarray:
    """Errors of the links' base parameters in units of the largest of their kind."""
    base = base_map(robot)
    truth = dict(zip(base.names, base.combination @ robot.parameter_vector, strict=True))
    sizes = {"kg m": 1150.0, "kg m^2": 2000.0}
    return np.array(
        [
            (p.value - truth[p.name]) / sizes[p.unit]
            for p in found.parameters
            if p.name in truth and "_link" in p.name
        ]
    )


def test_auto_takes_weighted_least_squares_on_good_data(
    quiet: Identification, robot: Robot
) -> None:
    assert quiet.estimator is not None
    assert quiet.estimator.name == "wls"
    assert "instruments give the same" in quiet.estimator.reason
    assert "(0.0)" not in quiet.estimator.reason
    assert " moves most, by " in quiet.estimator.reason
    assert np.max(np.abs(_errors(robot, quiet))) < 5e-3


def test_auto_turns_to_instruments_where_encoders_are_bad(robot: Robot) -> None:
    heavy = Noise(encoder_rad=2.0e-3)
    auto = _identified(heavy)
    plain = _identified(heavy, estimator="wls")
    assert auto.estimator is not None
    assert auto.estimator.name == "iv"
    assert "noise of the derivatives" in auto.estimator.reason
    assert np.max(np.abs(_errors(robot, auto))) < 0.05
    assert np.max(np.abs(_errors(robot, plain))) > 0.5


@pytest.mark.thorough
def test_auto_turns_robust_where_samples_stand_out(robot: Robot, with_outliers) -> None:
    good = synthetic_recording(robot, 20.0, 1)
    bad = with_outliers(good, 5, share=0.02, dropouts=6)
    auto = identify(robot, [bad])
    plain = identify(robot, [bad], settings=Settings(estimator="ols"))
    assert auto.estimator is not None
    assert auto.estimator.name == "robust"
    assert any("taken for outliers" in note for note in auto.notes)
    assert auto.verdict == "identified", auto.problems
    assert all(channel.summary()["fit_after_pct"] > 90.0 for channel in auto.channels)
    assert np.max(np.abs(_errors(robot, auto))) < 0.01
    assert np.max(np.abs(_errors(robot, plain))) > 0.03
    values = {p.name: p for p in auto.parameters}
    for valve in robot.valves:
        assert values[f"{valve.name}.c_pa"].value == pytest.approx(valve.c_pa, rel=0.02)


@pytest.mark.thorough
def test_outliers_of_a_recording_that_validates_are_no_error_of_the_model(
    robot: Robot, with_outliers
) -> None:
    good = synthetic_recording(robot, 20.0, 1)
    other = synthetic_recording(robot, 20.0, 2)
    bad = replace(with_outliers(other, 6, share=0.02, dropouts=6), path=other.path / "check")
    found = identify(robot, [with_outliers(good, 5, share=0.02, dropouts=6)], [bad])
    assert found.verdict == "identified", found.problems
    assert all(channel.summary()["fit_after_pct"] > 90.0 for channel in found.channels)
    assert any("taken for outliers" in n and n.startswith("check") for n in found.notes)


@pytest.mark.thorough
@pytest.mark.parametrize("estimator", ["ols", "robust"])
def test_every_estimator_agrees_on_good_data(
    quiet: Identification, robot: Robot, estimator: str
) -> None:
    other = _identified(Noise(), estimator=estimator)
    assert other.estimator is not None
    assert other.estimator.name == estimator
    assert np.max(np.abs(_errors(robot, other))) < 5e-3
    for a, b in zip(quiet.parameters, other.parameters, strict=True):
        assert a.name == b.name
        assert np.isfinite(b.std)


@pytest.mark.thorough
@pytest.mark.parametrize(("times", "most"), [(10.0, 1.15), (100.0, 1.35)])
def test_bags_of_unlike_noise_are_weighted_by_it(robot: Robot, times: float, most: float) -> None:
    """Weights rest on a fit in which both count alike, so that a very loud bag costs a little."""
    quiet = synthetic_recording(robot, 20.0, 1, Noise(force_n=50.0))
    loud = synthetic_recording(robot, 20.0, 1, Noise(force_n=50.0 * times))
    loud = replace(loud, path=quiet.path / "b")
    settings = Settings(hold_out_every=0, estimator="wls")
    alone, both = (identify(robot, b, settings=settings) for b in ([quiet], [quiet, loud]))
    for a, b in zip(alone.parameters, both.parameters, strict=True):
        if a.identifiable and "_link" in a.name:
            assert b.std < most * a.std, a.name
            assert abs(a.value - b.value) < a.std, a.name
