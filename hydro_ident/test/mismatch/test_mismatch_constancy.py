"""One size all along, and what the form of a model may leave: of numbers, and of machines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.locating.flaws import Flaws, swinging
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.locating.precision import measured_size
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.settings import FAMILY_ERROR, PRECISION_UNNAMED
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.constancy import COMES_AND_GOES, inconstancy
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.unnamed.unknown import Unexplained, unexplained
from hydro_ident.mismatch.unnamed.wavering import (
    Wavering,
    _chance,
    _direction,
    _is_left,
    _there,
    _wavering,
    wavering,
)
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_ident.mismatch.verifying.verify import Verification, verify
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

ROWS, STEP_S, BLOCK_S = 3000, 0.02, 1.0
COULOMB = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 1500.0})


def _changes(share: float, low: float, seed: int = 5, size: float = 1.0) -> float:
    """What is said of a column that has `low` of its size for a share of the time."""
    rng = np.random.default_rng(seed)
    zeros, time = np.zeros(ROWS, dtype=np.intp), np.arange(ROWS) * STEP_S
    column = np.sin(2.0 * np.pi * 0.9 * time)
    there = np.where(np.floor(time / 6.0) % 10 < 10 * share, low, 1.0)
    residual = size * there * column + rng.normal(size=ROWS)
    layout = Layout(zeros, zeros, time, np.arange(ROWS) > 0)
    white = Noise((np.zeros(0),), np.ones(1))
    return inconstancy(Bench(layout, white, residual, np.ones((ROWS, 1)), BLOCK_S), column)


def test_an_effect_of_the_machine_has_one_size() -> None:
    assert [_changes(0.5, 1.0, seed) for seed in range(40)].count(0.0) >= 39


def test_what_is_there_half_the_time_changes_by_its_own_size() -> None:
    """Mean c / 2 and deviation c / 2."""
    assert _changes(0.5, 0.0) == pytest.approx(1.0, rel=0.15)


def test_what_is_there_for_a_fifth_changes_by_twice_its_size() -> None:
    """Mean c / 5, deviation c sqrt(0.2 0.8)."""
    assert _changes(0.8, 0.0) == pytest.approx(2.0, rel=0.15)


def test_a_size_that_varies_a_little_is_one_size() -> None:
    """Mean 0.85 c and deviation 0.15 c: told, and far from coming and going."""
    assert _changes(0.5, 0.7, size=4.0) == pytest.approx(0.15 / 0.85, rel=0.2)
    assert 0.5 * COMES_AND_GOES > 0.15 / 0.85


def test_what_noise_hides_is_not_said_to_change() -> None:
    assert _changes(0.5, 0.0, size=0.1) == 0.0


# Machines -------------------------------------------------------------------------------------


def _pushed(run: Any, force: np.ndarray) -> Any:
    """The same motion against another force (N,) on the lift cylinder's piston."""
    p_a = run.p_a.copy()
    p_a[:, 0] += force / run.robot.cylinders[0].area_a_m2
    return replace(run, p_a=p_a)


def _verified(work: Residuals, few: float = 1.0) -> Verification:
    """Dry friction put to a check, as a search would hand it on."""
    one = resolve(replace(load_robot("xs031"), effects=(COULOMB,)))[0]
    whole = fit(work.training, work.base.model.with_term(one))
    gain = work.base.squares - whole.squares
    named = named_of([Contender(whole.model.terms[-1], whole, gain, gain, 4.0)], 0.001, 1.0, few)
    return verify(work.training, whole, named, work.check)


def _told(work: Residuals, going: dict[str, str] | None = None) -> dict[str, Unexplained]:
    left = dependences(work.training, work.base)
    holds = Confirmer(work.training, work.check, work.base).holds
    found = unexplained(work.training, work.base, left, holds, going=going or {})
    return {one.channel: one for one in found}


def _dragged(run: Any, there: np.ndarray) -> Any:
    """The same motion against dry friction where it is there."""
    speed = np.gradient(np.convolve(run.q[:, 0], np.ones(25) / 25.0, "same"), 0.002)
    return _pushed(run, 2500.0 * there * np.tanh(speed / 0.01))


def test_a_drag_that_comes_and_goes_is_no_friction(
    crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    time = np.arange(len(crane_run.q)) * 0.002
    work = lay_out(_dragged(crane_run, np.floor(time / 1.7) % 2.0))
    found = _verified(work)
    assert not found.stands
    assert found.comes_and_goes
    assert found.reason.startswith("it comes and goes")
    # In few motions stretches of time are stretches of the law itself.
    few = _verified(work, few=8.0)
    assert (few.stands, few.comes_and_goes) == (True, False)


def test_friction_all_along_does_not_come_and_go(
    crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    found = _verified(lay_out(_dragged(crane_run, np.ones(len(crane_run.q)))))
    assert found.stands, found.reason
    assert not found.comes_and_goes


def test_what_comes_and_goes_is_told(laid_crane: Residuals) -> None:
    work = laid_crane
    assert not _told(work)
    one = _told(work, {"lift/force": "coulomb_friction"})["lift/force"]
    assert one.depends_on == ("time",)
    assert "comes and goes" in one.text
    assert "coulomb_friction" in one.text
    # No dependence, and so no chance of one: its curve is the drag's over time.
    assert one.p_value is None
    assert (one.dependence.variable, one.dependence.times) == ("time", "direction")


@pytest.fixture(scope="module")
def minute(make_run: tuple[Callable[..., Any], Callable[..., Any]]) -> Any:
    """A minute's run of the plain machine."""
    crane, simulated_run = make_run
    return simulated_run(crane(), 60.0)


def _up_together(run: Any) -> np.ndarray:
    """Times, three eighths of all, at which two swings of no common period are up together."""
    turned = 0.6 * np.arange(len(run.q)) * 0.002
    return np.sin(turned) + np.sin(1.7 * turned) > 0.3


def _wavers(work: Residuals) -> dict[str, Wavering]:
    return wavering(work.training, work.base, Confirmer(work.training, work.check, work.base))


@pytest.mark.thorough
def test_a_drag_without_a_rhythm_is_told_with_what_it_is_at_times(
    minute: Any, lay_out: Callable[..., Residuals]
) -> None:
    there = _up_together(minute)
    work = lay_out(_dragged(minute, 0.1 * there))
    wavers = _wavers(work)
    one = wavers["lift/force"]
    assert one.mean == pytest.approx(250.0 * there.mean(), rel=0.15)
    # Stretches of one to three seconds hold both: they differ by less than all instants do.
    assert 0.6 < one.deviation / (250.0 * there.std()) < 1.0
    holds = Confirmer(work.training, work.check, work.base).holds
    # Where no smooth function of time is told, which follows some of it.
    left = [replace(d, p_value=1.0) for d in dependences(work.training, work.base)]
    (told,) = unexplained(work.training, work.base, left, holds, wavers=wavers)
    assert told.channel == "lift/force"
    assert told.depends_on == ("time", "piston_velocity")
    assert "comes and goes" in told.text


@pytest.mark.thorough
def test_mean_and_change_of_a_drag_are_told_together(
    minute: Any, lay_out: Callable[..., Residuals]
) -> None:
    """A drag of few seconds: its mean could be chance once in a hundred, its change could not."""
    time = np.arange(len(minute.q)) * 0.002
    seldom = (np.floor(time / 2.0) % 10.0 == 3.0) | (np.floor(time / 1.5) % 17.0 == 5.0)
    rng = np.random.default_rng(3)
    noise = np.repeat(rng.normal(0.0, 90.0, len(time) // 50 + 1), 50)[: len(time)]
    work = lay_out(_pushed(_dragged(minute, 0.12 * seldom), noise))
    bench, direction = _direction(work.training, work.base, 0)
    assert bench is not None
    assert 2.0 * _chance(bench, direction) > FAMILY_ERROR
    found = _wavering(work.training, work.base, Flaws.of(work.training, work.base), 0, 2)
    assert found is not None
    assert found.deviation > found.mean > 0.0


@pytest.mark.thorough
def test_rows_in_which_a_drag_would_not_stand_out_say_nothing_of_it(
    minute: Any, lay_out: Callable[..., Residuals]
) -> None:
    time = np.arange(len(minute.q)) * 0.002
    rng = np.random.default_rng(6)
    restless = np.repeat(rng.normal(0.0, 2000.0, len(time) // 100 + 1), 100)[: len(time)]
    for other, told in ((_pushed(minute, restless), None), (minute, False)):
        work = lay_out(minute, [other])
        confirmer = Confirmer(work.training, work.check, work.base)
        assert _there(confirmer, "lift/force", 60.0) is told


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["nothing", "all along", "whatever moves"])
def test_what_does_not_come_and_go_against_the_motion(
    minute: Any, lay_out: Callable[..., Residuals], kind: str
) -> None:
    """Nothing, dry friction all along, and as large a force that knows nothing of the motion."""
    there = _up_together(minute)
    run = {
        "nothing": minute,
        "all along": _dragged(minute, np.full(there.size, 0.1)),
        "whatever moves": _pushed(minute, np.where(there, 250.0, -250.0)),
    }[kind]
    assert not _wavers(lay_out(run))


@pytest.mark.parametrize(("gain", "told"), [(0.01, True), (0.04, False)])
def test_beside_what_is_named_a_drag_is_no_small_part_of_it(
    minute: Any, lay_out: Callable[..., Residuals], gain: float, told: bool
) -> None:
    """Its law's own form may leave a little of a large effect here and there."""
    run = _dragged(minute, 0.1 * _up_together(minute))
    p_a = run.p_a.copy()
    p_a[:, 0] *= 1.0 + gain
    work = lay_out(replace(run, p_a=p_a))
    spec = EffectSpec("pressure_sensor_gain", "lift_cylinder/a", {"error": gain})
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    whole = fit(work.training, work.base.model.with_term(one))
    found = wavering(work.training, whole, Confirmer(work.training, work.check, whole))
    assert ("lift/force" in found) is told


@pytest.mark.parametrize(("unlike", "left"), [(0.03, False), (0.3, True)])
def test_what_a_named_friction_leaves_of_the_direction_has_to_be_some_of_it(
    unlike: float, left: bool
) -> None:
    """Of next to nothing a size from stretch to stretch would be any number."""
    rng = np.random.default_rng(8)
    zeros, time = np.zeros(ROWS, dtype=np.intp), np.arange(ROWS) * STEP_S
    direction = np.sign(np.sin(2.0 * np.pi * 0.2 * time))
    friction = direction + unlike * rng.normal(size=ROWS)
    layout = Layout(zeros, zeros, time, np.arange(ROWS) > 0)
    white = Noise((np.zeros(0),), np.ones(1))
    bench = Bench(layout, white, rng.normal(size=ROWS), friction[:, None], BLOCK_S)
    assert _is_left(bench, direction) is left


# The form's own flaws -------------------------------------------------------------------------


def test_how_much_of_a_signal_swings_at_a_frequency() -> None:
    time = np.arange(0.0, 20.0, 0.002)
    signal = 3.0 + 4.0 * np.sin(2.0 * np.pi * 0.25 * time) + 0.3 * np.cos(2.0 * np.pi * 7.0 * time)
    size, one = np.sqrt(8.0 + 0.045), np.zeros(time.size, dtype=np.intp)
    assert swinging(time, signal, 7.0, one) == pytest.approx(np.sqrt(0.045) / size, rel=1e-3)
    assert swinging(time, signal, 0.25, one) == pytest.approx(np.sqrt(8.0) / size, rel=1e-3)
    assert swinging(time, signal, 3.0, one) < 1e-3
    assert swinging(time, np.ones(time.size), 7.0, one) == 0.0
    # As much in two recordings, in which it swings against each other.
    both, which = np.concatenate([signal, 6.0 - signal]), np.repeat([0, 1], time.size)
    twice = np.concatenate([time, time])
    assert swinging(twice, both, 7.0, which) == pytest.approx(np.sqrt(0.045) / size, rel=1e-3)


@pytest.mark.thorough
def test_a_hum_is_told_at_a_size_at_which_a_flaw_of_the_form_is_not(
    crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    """A law that is off by a thousandth leaves what moves; at 4 Hz hardly anything does."""
    time = np.arange(len(crane_run.q)) * 0.002
    piston = crane_run.robot.cylinders[0]
    measured = piston.area_a_m2 * crane_run.p_a[:, 0] - piston.area_b_m2 * crane_run.p_b[:, 0]
    size = 0.5e-3 * float(np.sqrt(np.mean(measured**2)))
    hum = lay_out(_pushed(crane_run, size * np.sqrt(2.0) * np.sin(2.0 * np.pi * 4.0 * time)))
    told = _told(hum)["lift/flow_a"]
    assert told.depends_on == ("time",)
    assert told.dependence.period == pytest.approx(0.25, rel=0.01)
    flow = measured_size(hum.training, hum.base.model, told.dependence.channel)
    assert told.dependence.size < PRECISION_UNNAMED * flow
    swing = crane_run.q[:, 0] - crane_run.q[:, 0].mean()
    flaw = swing**2 - np.mean(swing**2)
    flawed = lay_out(_pushed(crane_run, size * flaw / np.std(flaw)))
    assert "lift/force" not in _told(flawed)
