"""Which channels lack something, whatever it is: far above the sensors' noise, or grossly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.scoring.noise import force_noise
from hydro_ident.mismatch.answer.channel_results import channels_of, rows_of_training
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.lacking import distance, lacking, lacking_elsewhere
from hydro_ident.mismatch.answer.notes import apart, apart_notes
from hydro_ident.mismatch.answer.outcome import ChannelResult
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.locating.precision import accuracy_of
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.unnamed.unknown import Unexplained, unexplained
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_model.robot import EffectSpec, Robot

TIMES = np.arange(4000.0) * 0.05
FORCE = 20e3 + 1000.0 * np.sqrt(2.0) * np.sin(0.8 * TIMES)


def _channel(left_n: float, floor_n: float) -> ChannelResult:
    """A force of 20 kN that varies by 1 kN (rms), of which so much is left (rms)."""
    left = left_n * np.random.default_rng(2).normal(size=TIMES.size)
    after = FORCE - left * left_n / np.sqrt(np.mean(left**2))
    return ChannelResult("lift/force", "N", TIMES, FORCE, after, after, floor_n)


@pytest.mark.parametrize(
    ("left_n", "floor_n", "told"),
    [
        (220.0, 73.0, True),  # three times the noise, a fifth of what varies
        (220.0, 100.0, False),  # little more than the noise
        (80.0, 20.0, False),  # little of what varies
        (650.0, 60.0, True),
        (80.0, 2.0, False),  # far above the noise, and nothing beside the signal
        (700.0, 0.0, False),  # no noise is known to hold it against
    ],
)
def test_what_is_left_is_held_against_noise_and_signal(
    left_n: float, floor_n: float, told: bool
) -> None:
    one = _channel(left_n, floor_n)
    assert distance(one, 0.0) == pytest.approx(left_n / floor_n if told else 0.0)


def test_a_channel_lacks_something_where_it_does_in_both_recordings() -> None:
    grossly, hardly = _channel(220.0, 73.0), _channel(80.0, 73.0)
    least = {"lift/force": 0.0}
    assert lacking([grossly], [grossly], least) == {"lift/force": pytest.approx(220.0 / 73.0)}
    assert lacking([grossly], [hardly], least) == {}
    assert lacking([hardly], [grossly], least) == {}


def test_where_nothing_is_verified_the_fitted_rows_say_that_something_lacks() -> None:
    grossly, hardly = _channel(220.0, 73.0), _channel(80.0, 73.0)
    least = {"lift/force": 0.0}
    assert lacking([grossly], [], least) == {"lift/force": pytest.approx(220.0 / 73.0)}
    assert lacking([hardly], [], least) == {}


def test_a_model_that_other_recordings_contradict_lacks_something() -> None:
    """Ten times the noise and more, which is not little beside what is measured."""
    hardly, grossly, far = _channel(80.0, 73.0), _channel(220.0, 73.0), _channel(650.0, 60.0)
    least = {"lift/force": 0.0}
    floors = {"lift/force": 60.0}
    told = lacking_elsewhere([hardly], [far], least, floors)
    assert "11 times" in told["lift/force"]
    assert "8.1 times what is left where it was fitted" in told["lift/force"]
    assert lacking_elsewhere([hardly], [grossly], least, floors) == {}
    # As bad where it was fitted, and hardly worse there.
    assert lacking_elsewhere([far], [far], least, floors) == {}
    assert lacking_elsewhere([_channel(580.0, 60.0)], [far], least, floors) == {}
    # Its sensors there are noisier, or off by as much.
    assert lacking_elsewhere([hardly], [far], least, {"lift/force": 73.0}) == {}
    assert lacking_elsewhere([hardly], [far], {"lift/force": 700.0}, floors) == {}
    assert lacking_elsewhere([], [far], {}, floors) == {}  # nothing of it was fitted


def test_what_transducers_of_the_usual_class_are_off_by_lacks_nothing() -> None:
    """However quiet they are from one sample to the next."""
    far = _channel(650.0, 2.0)
    assert lacking([far], [far], {"lift/force": 500.0}) == {"lift/force": pytest.approx(325.0)}
    assert lacking([far], [far], {"lift/force": 700.0}) == {}


def test_that_is_a_share_of_the_range_on_both_areas(
    make_run: tuple, lay_out: Callable[..., Residuals], robot: Robot
) -> None:
    true_crane, simulated_run = make_run
    material = lay_out(simulated_run(true_crane(), 10.0)).training.predictor.material
    lift = next(c for c in robot.cylinders if c.joint == "lift")
    expected = 1.25e-3 * robot.sensors.pressure_range_pa * np.hypot(lift.area_a_m2, lift.area_b_m2)
    assert accuracy_of(material, material.channels.index("lift/force")) == pytest.approx(expected)
    assert accuracy_of(material, material.channels.index("lift/flow_a")) == 0.0


def test_what_another_motion_knows_better_is_noted(
    make_run: tuple, lay_out: Callable[..., Residuals]
) -> None:
    """A load that was picked up before the second recording: no step of either tells it."""
    true_crane, simulated_run = make_run
    plain, crane = simulated_run(true_crane(), 10.0), true_crane()
    spec = EffectSpec("payload_change", crane.name, {"mass": 60.0, "start_s": -10.0})
    loaded = simulated_run(replace(crane, effects=(spec,)), 10.0)
    for given, names in ((loaded, ["lift/force", "tilt/force"]), (plain, [])):
        work = lay_out(plain, [given])
        ratios = apart(work, work.base, channels_of(work, work.base, work.check))
        assert list(ratios) == names
        assert all(ratio > 2.0 for ratio in ratios.values())
        rows = rows_of_training(work), work.check
        here, there = (channels_of(work, work.base, own) for own in rows)
        least = dict.fromkeys(work.training.predictor.material.channels, 0.0)
        floors = work.noise_floors(work.check_traces)
        contradicted = lacking_elsewhere(here, there, least, floors)
        assert list(contradicted) == names
        notes = apart_notes(ratios)
        assert [note.partition(":")[0] for note in notes] == names
        assert all("diagnose the other way round" in note for note in notes)


@pytest.mark.thorough
def test_what_dry_friction_holds_at_rest_leaves_no_doubt(
    make_run: tuple[Callable[..., Any], Callable[..., Any]], robot: Robot
) -> None:
    """There it is whatever the load asks for, and 3 kN beside what the model says at no speed."""
    true_crane, simulated_run = make_run
    dry = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0})
    run = simulated_run(replace(true_crane(), effects=(dry,)), 20.0)
    rng, count = np.random.default_rng(2), 15_000
    cylinder = robot.cylinders[0]

    def resting(values: np.ndarray, noise: float) -> np.ndarray:
        return np.concatenate(
            [values, values[5000] + noise * rng.normal(size=(count, *values.shape[1:]))]
        )

    p_a = resting(run.p_a, 4e3)
    p_a[len(run.q) :, 0] += 3000.0 / cylinder.area_a_m2
    whole = replace(
        run, q=resting(run.q, 3e-6), p_a=p_a, p_b=resting(run.p_b, 4e3),
        voltage=np.concatenate([run.voltage, np.zeros((count, 2))]),
    )  # fmt: skip
    stamps = whole.recording().stamp_ns.copy()
    stamps[len(run.q) :] += 5_000_000_000
    found = diagnose(robot, [whole.recording(stamp_ns=stamps)])
    assert [f.named.names[0] for f in found.findings] == ["coulomb_friction"]
    (lift,) = (c for c in found.channels if c.name == "lift/force")
    # Rest included, more is left than was explained.
    assert rms(lift.measured - lift.after) > 0.7 * rms(lift.measured - lift.before)
    assert found.verdict == "explained"


def test_floors_of_a_diagnosis_are_of_its_fitted_inertia(rubbing: Residuals) -> None:
    floors = rubbing.noise_floors()
    material, fitted = rubbing.training.predictor.material, rubbing.base.model.robot
    for robot, same in ((fitted, True), (None, False)):
        noise = force_noise(material.forces, rubbing.signals, material.filters, robot)
        own = [floors[name] for name in material.forces.channels]
        assert (own == pytest.approx(noise.tolist(), rel=1e-12)) is same


def test_a_little_that_follows_something_does_not_hide_that_all_of_a_channel_lacks_something(
    rubbing: Residuals,
) -> None:
    """Friction without a name follows the velocity; a fifth of what is left is little of it."""
    left = dependences(rubbing.training, rubbing.base)
    holds = Confirmer(rubbing.training, rubbing.check, rubbing.base).holds

    def told(share: float) -> list[Unexplained]:
        some = [replace(d, share=share) if d.name == "lift/force" else d for d in left]
        far = {"lift/force": 3500.0}
        found = unexplained(rubbing.training, rubbing.base, some, holds, far)
        return [one for one in found if one.channel == "lift/force"]

    (alone,) = told(0.9)
    little, rest = told(0.2)
    assert "everywhere" not in alone.depends_on
    assert alone.depends_on == little.depends_on
    assert (rest.depends_on, rest.share) == (("everywhere",), pytest.approx(0.8))
    assert "3.5e+03 times" in rest.text
    assert "80% of it does not follow" in rest.text
