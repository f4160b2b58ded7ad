"""Laws of acceleration on machines whose encoders are noisy: noise is no spring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.mismatch.locating import encoders
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.encoders import Encoders
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.fit_starts import Starts
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.candidates import trials
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.trials.scoring import bank_of, score
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
#: A coarse encoder, and one that shows the spring below.
COARSE_RAD, FINE_RAD = 2e-4, 3e-5
MODE = {"inertia": 250.0, "frequency": 7.1, "damping": 0.1}
SPRING = EffectSpec("structural_flexibility", "lift_cylinder", MODE)
COUPLED = EffectSpec("joint_coupling", "lift_cylinder", {"viscous": 300.0, "inertia": 60.0})


def _seen(
    make_run: Make, lay_out: Callable[..., Residuals], noise_rad: float, *effects: EffectSpec
) -> Residuals:
    """A machine with some effects, whose encoders are noisy."""
    true_crane, simulated_run = make_run
    run = simulated_run(replace(true_crane(), effects=effects), 18.0)
    noise = noise_rad * np.random.default_rng(3).normal(size=run.q.shape)
    return lay_out(replace(run, q=run.q + noise))


def _fitted(work: Residuals, spec: EffectSpec) -> Contender:
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    [found] = Contest(work.training).fitted(work.base, [one], work.base.bench.noise)
    return found


@pytest.fixture(scope="module")
def clean(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """A machine without any effect."""
    return _seen(make_run, lay_out, COARSE_RAD)


def test_a_spring_that_is_noise_is_told_as_noise(clean: Residuals) -> None:
    """Its 600 kg m^2 gain more than three numbers do by chance: noise that goes with noise.

    Not quite all of it, as of all frequencies and dampings the best is taken.
    """
    found, encoders = _fitted(clean, SPRING), Encoders(clean.training)
    assert found.gain > 11.3  # chi-square of 3 at 1 %
    assert 0.4 < encoders.share(clean.base, found) < 1.2
    assert not encoders.tell(clean.base, found)


@pytest.mark.parametrize(
    "spec",
    [pytest.param(SPRING, marks=pytest.mark.thorough, id=SPRING.name),
     pytest.param(COUPLED, id=COUPLED.name)],
)  # fmt: skip
def test_what_is_there_is_told_beside_noise(
    spec: EffectSpec, make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    work = _seen(make_run, lay_out, FINE_RAD, spec)
    found, encoders = _fitted(work, spec), Encoders(work.training)
    assert abs(encoders.share(work.base, found)) < 0.1
    assert encoders.tell(work.base, found)
    first = next(iter(spec.parameters))
    names = [p.name for p in found.term.effect.parameters]
    size = float(found.term.parameters[names.index(first)])
    assert size == pytest.approx(spec.parameters[first], rel=0.15)


@pytest.mark.thorough
@pytest.mark.parametrize("there", [False, True])
def test_a_contest_tells_springs_that_are_there_alone(
    there: bool, clean: Residuals, make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    work = _seen(make_run, lay_out, FINE_RAD, SPRING) if there else clean
    training, base = work.training, work.base
    tried = trials(training.predictor, base.model, (SPRING.name,))
    own = [trial for trial in tried if trial.target == SPRING.target]
    entries = bank_of(training.predictor, base.model, own)
    scores = [s for e in entries if (s := score(base.bench, e, training.mask)) is not None]
    best = max(scores, key=lambda s: s.value)
    named, told = Contest(training).between(base, base.bench.noise, scores, best, 0.001)
    assert named.names == (SPRING.name,)
    assert told == there


def test_laws_without_acceleration_are_not_asked(clean: Residuals) -> None:
    dry = _fitted(clean, EffectSpec("coulomb_friction", "lift_cylinder", {"force": 1.0}))
    assert Encoders(clean.training).tell(clean.base, dry)


@pytest.fixture(scope="module")
def sprung(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    return _seen(make_run, lay_out, FINE_RAD, SPRING)


@pytest.mark.thorough
def test_there_is_no_more_noise_than_a_fit_leaves(
    sprung: Residuals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Encoders that are ten times as good as is thought of them hide no spring."""
    found = _fitted(sprung, SPRING)
    thought = 10.0 * encoders.encoder_noise(
        SignalSurvey.of(
            sprung.robot, [s.trace for s in sprung.training.predictor.material.stretches]
        )
    )
    monkeypatch.setattr(encoders, "encoder_noise", lambda _: thought)
    assert Encoders(sprung.training).tell(sprung.base, found)


def test_fits_of_modes_begin_between_the_frequencies_that_are_tried(sprung: Residuals) -> None:
    one = resolve(replace(load_robot("xs031"), effects=(SPRING,)))[0]
    values = one.parameters.copy()
    values[:2] = 100.0, 6.3  # a third of an octave is tried: 6.3 and 7.9 Hz
    start = Starts(sprung.training)._tuned(sprung.base, replace(one, parameters=values))
    # Less than half as far off as the one that was tried.
    assert abs(start.parameters[1] - MODE["frequency"]) < 0.5 * (MODE["frequency"] - 6.3)
    assert start.parameters[0] == pytest.approx(MODE["inertia"], rel=0.4)


def _line(work: Residuals) -> Dependence:
    """What swings in the lift's force once a second, as the motion does for a while."""
    channel = work.training.predictor.material.channels.index("lift/force")
    none = np.zeros(0)
    return Dependence(
        channel, "lift/force", "time", "", 1.0, 2, 1.0, 1e-4, 0.5, 1.0, none, none, none, 1.0
    )


@pytest.mark.thorough
def test_a_line_that_noise_makes_of_inertia_is_told_from_one_that_is_there(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """Noise makes the inertia that is fitted too small: what is left swings with the motion."""
    noisy = _seen(make_run, lay_out, 6e-4)
    assert Encoders(noisy.training).makes(noisy.base, _line(noisy))
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 18.0)
    time_s, p_a = 0.002 * np.arange(len(run.q)), run.p_a.copy()
    p_a[:, 0] += 5e3 * np.sin(2.0 * np.pi * time_s)
    hummed = lay_out(replace(run, p_a=p_a))
    assert not Encoders(hummed.training).makes(hummed.base, _line(hummed))


def _seen_as(noise: np.ndarray, kept: float) -> Any:
    """A predictor of a recording that is noise, of which a law keeps a share out of the force."""

    def residual(model: str) -> np.ndarray:
        return (1.0 - kept) * noise if model == "with the law" else noise

    material = SimpleNamespace(channels=("lift/force",), is_flow=lambda _: False)
    return SimpleNamespace(
        material=material, residual=residual, contribution=lambda *_: kept * noise
    )


@pytest.mark.parametrize("thought", [1.0, 10.0])
def test_what_a_law_keeps_out_of_the_noise_is_no_sign_that_there_is_less_of_it(
    thought: float,
) -> None:
    """A mode far below the noise takes three quarters of the inertia away, and noise with it."""
    there, *more = np.random.default_rng(5).normal(size=(3, 2000))
    mask, kept = np.ones(there.size, dtype=bool), 0.75
    training: Any = SimpleNamespace(mask=mask, predictor=_seen_as(there, kept))
    encoders = Encoders(training)
    encoders.__dict__["_twins"] = [_seen_as(there + thought * one, kept) for one in more]
    bench = SimpleNamespace(
        beyond=lambda columns: columns, residual=there, channel=np.zeros(there.size, dtype=int)
    )
    whole = SimpleNamespace(model="with the law", left=(1.0 - kept) * there)
    without: Any = SimpleNamespace(model="without", bench=bench)
    law: Any = SimpleNamespace(term=None, fitted=whole)
    assert encoders.share(without, law) == pytest.approx(1.0, abs=0.1)
