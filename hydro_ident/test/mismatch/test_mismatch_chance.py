"""What chance is allowed: over many candidates, dependent rows and laws that predict alike."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_ident.mismatch.fitting.bench import Bench, Partial
from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.settings import SEED
from hydro_ident.mismatch.trials.candidates import Trial
from hydro_ident.mismatch.trials.chance import chances, foremost, reached, signs
from hydro_ident.mismatch.trials.contender import Contender, at_a_bound
from hydro_ident.mismatch.trials.scoring import Entry, Score, score
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

ROWS, STEP_S, BLOCK_S, LEVEL = 1200, 0.05, 2.0, 0.05
#: A fit of nothing: no number of it has a deviation.
UNFITTED = Weighed(None, (), np.zeros((0, 0)), np.zeros(0))  # type: ignore[arg-type]
WHITE = Noise((np.zeros(0),), np.ones(1))
LAWS = (
    EffectSpec("coulomb_friction", "lift_cylinder", {"force": 1500.0}),
    EffectSpec("asymmetric_friction", "lift_cylinder", {"force": 500.0, "viscous": 1000.0}),
)


@pytest.fixture(scope="module")
def laws(robot: Robot) -> list[ActiveEffect]:
    return list(resolve(replace(robot, effects=LAWS)))


def _layout() -> Layout:
    linked = np.arange(ROWS) > 0
    zeros = np.zeros(ROWS, dtype=np.intp)
    return Layout(zeros, zeros, np.arange(ROWS) * STEP_S, linked)


def _slow(rng: np.random.Generator, size: int) -> np.ndarray:
    """Columns that hang together over about a third of a block."""
    white = rng.normal(size=(ROWS + 200, size))
    return np.asarray(lfilter([1.0], [1.0, -0.9], white, axis=0)[200:])


def _p_value(residual: np.ndarray, candidates: np.ndarray, one: ActiveEffect) -> float:
    """Chance of the best of some candidates, as the search asks for it."""
    bench = Bench(_layout(), WHITE, residual, np.ones((ROWS, 1)), BLOCK_S)
    rows = np.ones(ROWS, dtype=bool)
    mask = np.ones(ROWS, dtype=bool)
    trial = Trial(one, (one.parameters,), (-1,), (True,))
    entries = [Entry(trial, rows, column[:, None]) for column in candidates.T]
    scores = [found for e in entries if (found := score(bench, e, mask)) is not None]
    flips = signs(bench.blocks)[:399]
    return min(chances(scores, scores, flips))


def _most(draws: int) -> float:
    """Findings by chance that are no surprise at the level."""
    return LEVEL * draws + 3.0 * float(np.sqrt(LEVEL * (1.0 - LEVEL) * draws))


def test_signs_are_kept_as_small_as_they_are() -> None:
    """Of minutes of recording, sets of several lengths: a byte for each sign, not eight."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        sizes = [signs(blocks, 4999).size for blocks in range(200, 208)]
        kept = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert kept <= 1.1 * sum(sizes)


def test_signs_are_always_the_same() -> None:
    drawn = np.random.default_rng(SEED).random((399, 30)) < 0.5
    for _ in range(2):
        np.testing.assert_array_equal(signs(30, 399), np.where(drawn, -1.0, 1.0))


def test_flips_that_reach_a_total_are_counted_with_the_one_that_was_seen() -> None:
    """Of four equal blocks one flip in sixteen leaves all signs as they are, five keep three."""
    alike = np.ones(4)
    assert reached(alike) == pytest.approx(1.0 / 16.0, abs=0.02)
    assert reached(alike, 2.0, 4999) == pytest.approx(5.0 / 16.0, abs=0.03)
    assert reached(alike, 5.0, 4999) == 1.0 / 5000.0
    assert reached(-alike) == reached(np.zeros(0)) == 1.0


def test_the_best_of_many_candidates_is_found_by_chance_as_seldom_as_said(
    laws: list[ActiveEffect],
) -> None:
    rng, draws = np.random.default_rng(11), 120
    found = sum(
        _p_value(rng.normal(size=ROWS), rng.normal(size=(ROWS, 15)), laws[0]) <= LEVEL
        for _ in range(draws)
    )
    assert found <= _most(draws)


def test_rows_that_hang_together_are_not_taken_for_independent(
    laws: list[ActiveEffect],
) -> None:
    """Where the noise model leaves dependence in the rows, whole blocks still hold the level."""
    rng, draws = np.random.default_rng(12), 150
    found = sum(
        _p_value(_slow(rng, 1)[:, 0], _slow(rng, 1), laws[0]) <= LEVEL for _ in range(draws)
    )
    assert found <= _most(draws)


@pytest.mark.parametrize("size", [0.0, 0.4])
def test_what_one_channel_still_holds_hides_nothing_in_another(
    laws: list[ActiveEffect], size: float
) -> None:
    """Half of the rows hold thirty times their noise; an effect in the others stands, or none."""
    rng, draws = np.random.default_rng(13), 100
    loud = np.arange(ROWS) < ROWS // 2
    found = 0
    for _ in range(draws):
        columns = rng.normal(size=(ROWS, 8)) * np.where(np.arange(8) < 4, loud[:, None], True)
        columns[:, 4:] *= ~loud[:, None]
        noise = rng.normal(size=ROWS) * np.where(loud, 30.0, 1.0)
        found += _p_value(noise + size * columns[:, -1], columns, laws[0]) <= LEVEL
    assert found <= _most(draws) if size == 0.0 else found >= 0.95 * draws


def test_what_stands_out_on_other_rows_is_taken_out_with_the_best(
    laws: list[ActiveEffect],
) -> None:
    """Of each set of rows the best, where no chance makes it so; never two on the same rows."""
    trial = Trial(laws[0], (laws[0].parameters,), (-1,), (True,))
    here = np.arange(ROWS) < ROWS // 3
    there = np.arange(ROWS) >= 2 * ROWS // 3
    between = ~(here | there)
    nothing = Partial(np.eye(1), np.zeros((1, 1)), np.ones(1), np.zeros((1, 1)))

    def scored(rows: np.ndarray, gain: float) -> Score:
        entry = Entry(trial, rows, np.ones((int(rows.sum()), 1)))
        return Score(entry, gain, np.ones(1), np.ones(1), nothing)

    best, rival, other, chance = (
        scored(*one) for one in ((here, 900.0), (here, 800.0), (there, 300.0), (between, 20.0))
    )
    assert foremost([chance, other, rival, best]) == [best, other]
    assert foremost([chance]) == [chance]


def _contender(term: ActiveEffect, held_out: float) -> Contender:
    return Contender(term, UNFITTED, 400.0, held_out, 3.0)


def test_laws_that_predict_alike_come_together(laws: list[ActiveEffect]) -> None:
    same = named_of([_contender(law, 380.0) for law in laws], 0.001, 1.0)
    assert set(same.names) == {law.effect.name for law in laws}
    assert same.probability == pytest.approx((0.5, 0.5))


def test_a_law_that_predicts_far_worse_is_not_in_the_set(laws: list[ActiveEffect]) -> None:
    pairs = zip(laws, (380.0, 100.0), strict=True)
    told = named_of([_contender(law, held) for law, held in pairs], 0.001, 1.0)
    assert told.names == (laws[0].effect.name,)
    assert told.probability[0] > 0.99


@pytest.fixture
def late(robot: Robot) -> list[ActiveEffect]:
    """A spool that lags, and a delay of its valve."""
    specs = (
        EffectSpec("valve_spool_lag", "lift_valve", {"frequency": 30.0, "damping": 0.7}),
        EffectSpec("command_delay", "lift_valve", {"delay": 0.007}),
    )
    return list(resolve(replace(robot, effects=specs)))


@pytest.mark.parametrize(
    ("lead", "first", "count"),
    [(900.0, "valve_spool_lag", 1), (150.0, "valve_spool_lag", 2), (-900.0, "command_delay", 2)],
)
def test_what_a_delay_leaves_where_a_lag_leaves_less_speaks_against_it(
    late: list[ActiveEffect], lead: float, first: str, count: int
) -> None:
    """Time has one form; a lag's is an idealisation, which may be off by a share of it."""
    lag, delay = sorted(late, key=lambda one: one.effect.name == "command_delay")
    gain = 4.0e6
    held = {lag.effect.name: gain + max(lead, 0.0), delay.effect.name: gain - min(lead, 0.0)}
    both = [Contender(one, UNFITTED, gain, held[one.effect.name], 4.0) for one in (lag, delay)]
    told = named_of(both, 0.001, 1.0)
    assert told.names[0] == first
    assert len(told.names) == count
    assert list(told.probability) == sorted(told.probability, reverse=True)


def test_the_likeliest_name_is_first_though_another_law_fits_best(
    late: list[ActiveEffect], robot: Robot
) -> None:
    """A delay of one valve and one of all are one name, which has the chances of both."""
    lag, delay = sorted(late, key=lambda one: one.effect.name == "command_delay")
    of_all = replace(delay, cylinder=None, target=robot.name)
    held = ((lag, 381.0), (delay, 380.0), (of_all, 380.0))
    told = named_of([Contender(one, UNFITTED, 400.0, h, 3.0) for one, h in held], 0.001, 1.0)
    assert told.names == ("command_delay", "valve_spool_lag")
    assert told.probability[0] > 0.5 > told.probability[1]
    assert told.term.effect.name == told.names[0]


@pytest.mark.parametrize(("held_out", "goes_first"), [(400.0, False), (500.0, True)])
def test_a_law_whose_size_may_be_anything_is_before_none_that_is_told(
    late: list[ActiveEffect], held_out: float, goes_first: bool
) -> None:
    """It says no more than what it comes to with another of its numbers.

    Unless that is far more than any law says whose size is told: an underlap by its width and its
    shift, of which the recording tells the product.
    """
    lag, delay = sorted(late, key=lambda one: one.effect.name == "command_delay")
    name, unknown = f"{lag.target}.valve_spool_lag.frequency", np.array([[600.0**2]])
    loose = replace(UNFITTED, names=(name,), covariance=unknown)
    otherwise = "valve_spool_lag" if goes_first else "command_delay"
    for weighed, first in ((loose, otherwise), (UNFITTED, "valve_spool_lag")):
        both = [
            Contender(lag, weighed, 400.0, held_out, 3.0),
            Contender(delay, UNFITTED, 400.0, 380.0, 3.0),
        ]
        assert named_of(both, 0.001, 1.0).names[0] == first


@pytest.mark.parametrize("better", ["coulomb_friction", "presliding_friction"])
def test_of_laws_of_one_name_the_better_one_stands_in_the_model(robot: Robot, better: str) -> None:
    """By little of the effect: it names the same cause, but elsewhere the forces are others."""
    specs = (
        EffectSpec("coulomb_friction", "lift_cylinder", {"force": 1500.0}),
        EffectSpec("presliding_friction", "lift_cylinder", {"force": 1500.0, "distance": 2e-5}),
    )
    gain, more = 2e6, {better: 100.0}
    contenders = [
        Contender(term, UNFITTED, gain, gain + more.get(term.effect.name, 0.0), cost)
        for term, cost in zip(resolve(replace(robot, effects=specs)), (6.7, 6.4), strict=True)
    ]
    found = named_of(contenders, 0.001, 1.0)
    assert found.names[0] == "coulomb_friction"
    assert found.term.effect.name == better


@pytest.mark.parametrize(
    ("distance_m", "names"),
    [
        (4e-4, ("presliding_friction",)),
        (2e-4, ("presliding_friction", "coulomb_friction")),
        (8e-5, ("coulomb_friction", "presliding_friction")),
        (3e-5, ("coulomb_friction",)),
    ],
)
def test_a_bristle_near_the_limit_of_its_name_bears_both(
    robot: Robot, distance_m: float, names: tuple[str, ...]
) -> None:
    parameters = {"force": 1500.0, "distance": distance_m}
    spec = EffectSpec("presliding_friction", "lift_cylinder", parameters)
    (law,) = resolve(replace(robot, effects=(spec,)))
    told = named_of([_contender(law, 380.0)], 0.001, 1.0)
    assert told.names == names
    assert told.probability == pytest.approx((1.0 / len(names),) * len(names))
    assert told.beside({"valve_spool_lag": 0.5}).names == (*names, "valve_spool_lag")


@pytest.mark.parametrize(
    ("falls_off_m_s", "distance_m", "names"),
    [
        (0.2, 4e-4, ("presliding_friction",)),
        (0.2, 2e-4, ("presliding_friction", "coulomb_friction")),
        (0.2, 8e-5, ("coulomb_friction", "presliding_friction")),
        (0.2, 3e-5, ("coulomb_friction",)),
        (0.07, 3e-5, ("coulomb_friction", "stribeck_friction")),
        (0.03, 3e-4, ("stribeck_friction",)),
    ],
)
def test_a_friction_that_lost_its_dip_bears_the_name_of_what_is_left(
    robot: Robot, falls_off_m_s: float, distance_m: float, names: tuple[str, ...]
) -> None:
    parameters = {"force": 1500.0, "stribeck_velocity": falls_off_m_s, "distance": distance_m}
    spec = EffectSpec("stribeck_friction", "lift_cylinder", parameters)
    (law,) = resolve(replace(robot, effects=(spec,)))
    assert named_of([_contender(law, 380.0)], 0.001, 1.0).names == names


@pytest.mark.parametrize(
    ("name", "further", "names"),
    [
        ("presliding_friction", {"distance": 2e-3}, ("presliding_friction",)),
        ("presliding_friction", {"distance": 1e-3}, ("presliding_friction", "coulomb_friction")),
        ("presliding_friction", {"distance": 1.5e-4}, ("coulomb_friction",)),
        ("stribeck_friction", {"stribeck_velocity": 0.15}, ("stribeck_friction",)),
    ],
)
def test_what_turns_has_the_limits_of_a_piston_at_a_lever(
    robot: Robot, name: str, further: dict[str, float], names: tuple[str, ...]
) -> None:
    """A bristle of 0.2 mrad at a quarter of a metre is one of 0.05 mm."""
    spec = EffectSpec(name, "lift_cylinder", {"force": 15.0} | further)
    (law,) = resolve(replace(robot, effects=(spec,)))
    turning = replace(law, cylinder=None, joint=1)
    assert named_of([_contender(turning, 380.0)], 0.001, 1.0).names == names


@pytest.mark.parametrize(
    ("name", "further", "names"),
    [
        ("presliding_friction", {"distance": 3.5e-4}, ("presliding_friction",)),
        ("presliding_friction", {"distance": 3e-5}, ("coulomb_friction",)),
        ("stribeck_friction", {"stribeck_velocity": 0.15}, ("coulomb_friction",)),
    ],
)
def test_what_slides_has_the_limits_of_a_piston(
    name: str, further: dict[str, float], names: tuple[str, ...]
) -> None:
    """It does so in metres: a bristle of a third of a millimetre is one, at a joint as well."""
    spec = EffectSpec(name, "carriage", {"force": 15.0} | further)
    (law,) = resolve(replace(load_robot("emps"), effects=(spec,)))
    assert law.prismatic
    assert named_of([_contender(law, 380.0)], 0.001, 1.0).names == names


@pytest.mark.parametrize(("stiffness", "none"), [(500.0, False), (50.0, True)])
def test_a_stop_of_what_slides_is_as_soft_as_a_ground_may_be(stiffness: float, none: bool) -> None:
    """500 N/m are soft beside 2000 N m/rad, but what slides has no lever to make them of."""
    spec = EffectSpec("external_contact", "carriage", {"stiffness": stiffness, "height": 0.1})
    (law,) = resolve(replace(load_robot("emps"), effects=(spec,)))
    assert bool(at_a_bound(law)) == none
