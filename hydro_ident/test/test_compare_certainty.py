"""What a comparison calls changed: few degrees of freedom, left-out physics, bags used twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from hydro_ident.bag.recording import read_recording
from hydro_ident.commands.identify import parser, run, settings_of
from hydro_ident.errors import IdentError
from hydro_ident.estimate.scoring.scores import HoldOut, in_turns
from hydro_ident.estimate.statistics.rows import Rows
from hydro_ident.identify.compare import Comparison, Sides, compare
from hydro_ident.identify.identification import Identification, identify
from hydro_ident.identify.significance import (
    CHANGED,
    NOT_CONCLUSIVE,
    f_tail,
    holm,
    two_sided,
    wald,
    welch_dof,
)
from hydro_ident.parameters.model_statistics import Statistics, read_statistics, statistics_of
from hydro_ident.parameters.parameters import Parameter
from hydro_model.robot import EffectSpec, Robot

EDGES = ("c_pa", "c_at", "c_pb", "c_bt")
#: What the machine has and the identified model does not.
LEFT_OUT = (
    EffectSpec("coulomb_friction", "xs031", {"force": 2500.0, "velocity_scale": 0.005}),
    EffectSpec("quadratic_friction", "xs031", {"coefficient": 5e4}),
    EffectSpec("internal_leakage", "xs031", {"coefficient": 2e-12}),
    EffectSpec("valve_deadband", "xs031", {"width": 0.01}),
)


def test_tails_are_those_of_scipy() -> None:
    assert two_sided(2.5, 7.0) == pytest.approx(2 * stats.t.sf(2.5, 7.0), rel=1e-12)
    assert two_sided(-2.5, np.inf) == pytest.approx(2 * stats.norm.sf(2.5), rel=1e-12)
    assert f_tail(18.0, 6, 11.0) == pytest.approx(stats.f.sf(3.0, 6, 11.0), rel=1e-12)
    assert f_tail(18.0, 6, np.inf) == pytest.approx(stats.chi2.sf(18.0, 6), rel=1e-12)
    # Two equal deviations with 5 degrees of freedom each have 10; an exact one has none to give.
    assert welch_dof([(2.0, 5.0), (2.0, 5.0)]) == pytest.approx(10.0)
    assert welch_dof([(2.0, 5.0), (0.0, np.inf)]) == pytest.approx(5.0)
    assert welch_dof([(2.0, np.inf)]) == np.inf
    assert holm([0.01, 0.04, 0.02]) == pytest.approx([0.03, 0.04, 0.04])
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
    step = np.array([1.0, -2.0])
    assert wald(step, covariance) == pytest.approx((step @ np.linalg.inv(covariance) @ step, 2))


def _drawn(robot: Robot, rng: np.random.Generator, dof: float, known: bool) -> Comparison:
    """Two unchanged machines, deviations estimated with few degrees of freedom."""
    names = [f"{v.name}.{e}" for v in robot.valves for e in EDGES]
    value = dict(zip(names, rng.normal(size=(len(names), 2)), strict=True))
    spread = np.sqrt(rng.chisquare(dof, size=(len(names), 2)) / dof)
    std = dict(zip(names, spread, strict=True))
    old = replace(
        robot,
        valves=tuple(
            replace(v, **{e: value[f"{v.name}.{e}"][0] for e in EDGES}) for v in robot.valves
        ),
        standard_deviations={n: float(std[n][0]) for n in names},
    )
    new = [Parameter(n, value[n][1], float(std[n][1]), "", None, True) for n in names]
    side = Statistics(dof=dict.fromkeys(names, dof) if known else {})
    return compare(old, robot, new, "old", Sides(side, side))


def test_few_degrees_of_freedom_raise_no_more_alarms(robot: Robot) -> None:
    rng = np.random.default_rng(5)
    count = 400
    alarms = {
        known: sum(
            any(c.changed for c in _drawn(robot, rng, 5.0, known).changes) for _ in range(count)
        )
        for known in (True, False)
    }
    assert alarms[True] <= stats.binom.ppf(0.999, count, 0.05)
    # Taken for exact, such deviations would raise twice as many.
    assert alarms[False] > 2 * 0.05 * count


def test_the_base_parameters_are_tested_by_f(robot: Robot) -> None:
    """A common factor of all deviations, known with 6 degrees of freedom on either side."""
    rng = np.random.default_rng(8)
    alarms = {6.0: 0, np.inf: 0}
    for _ in range(2000):
        scale = rng.chisquare(12.0) / 12.0
        statistic = float(np.sum(rng.normal(size=6) ** 2)) / scale
        for dof in alarms:
            alarms[dof] += f_tail(statistic, 6, 2 * dof) < 0.05
    assert alarms[6.0] <= stats.binom.ppf(0.999, 2000, 0.05)
    assert alarms[np.inf] > stats.binom.ppf(0.999, 2000, 0.05)


def test_model_error_makes_a_change_not_conclusive(robot: Robot) -> None:
    name = "lift_valve.c_pa"
    before = float(robot.valves[0].c_pa)
    old = replace(robot, standard_deviations={name: 3e-9})
    new = [Parameter(name, before + 5e-8, 4e-9, "", None, True)]
    sure = compare(old, robot, new, "old").changes[0]
    assert sure.changed
    side = Statistics(model_error={name: 2e-8})
    unsure = compare(old, robot, new, "old", Sides(side, side))
    [change] = unsure.changes
    assert change.test is not None
    assert change.test.outcome == NOT_CONCLUSIVE
    assert not change.changed
    assert change.std == pytest.approx(5e-9)
    assert change.model_error == pytest.approx(2e-8 * np.sqrt(2.0))
    assert any(note.startswith("not conclusive") for note in unsure.notes)
    moved = [replace(new[0], value=before + 2e-7)]
    assert compare(old, robot, moved, "old", Sides(side, side)).changes[0].changed


@pytest.fixture(scope="module")
def machine(
    make_run: tuple[Callable[..., Robot], Callable[..., object]], tmp_path_factory
) -> Callable[..., Identification]:
    """Identifies a simulated crane of which the model leaves physics out."""
    true_crane, simulated_run = make_run

    def identified(write: Callable[..., Path], robot: Robot, **how: float) -> Identification:
        truth = replace(true_crane(payload_kg=how.pop("payload_kg", 0.0)), effects=LEFT_OUT)
        made = simulated_run(truth, 20.0, **how)
        bag = write(made.columns(), name=f"run{how['seed']}")
        return identify(robot, [read_recording(bag, robot)])

    return identified


def _compared(old: Identification, new: Identification) -> Comparison:
    assert old.robot is not None
    assert new.robot is not None
    sides = [statistics_of(f.parameters, f.inertial, f.hydraulic, f.channels) for f in (old, new)]
    return compare(old.robot, new.robot, new.parameters, "old", Sides(*sides))


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
def test_left_out_physics_raises_no_alarm_and_hides_no_payload(
    machine: Callable[..., Identification], write_bag: Callable[..., Path], robot: Robot
) -> None:
    old = machine(write_bag, robot, seed=0, scale=1.0)
    # Forces are tens of times what sensor noise leaves.
    for channel in old.channels:
        summary = channel.summary()
        assert summary["rmse_after"] > 15.0 * summary["noise_floor"], channel.name
    alarms: list[str] = []
    for how in ({"seed": 1, "scale": 0.7}, {"seed": 2, "scale": 0.85}):
        same = machine(write_bag, robot, **how)
        result = _compared(old, same)
        assert [c.name for c in result.changes if c.changed] == []
        assert result.base is not None
        assert result.base.test.outcome != CHANGED
        naive = compare(old.robot, same.robot, same.parameters, "old")
        alarms += [c.name for c in naive.changes if c.changed]
    # Were noise all there is, at least one of the two would be called changed.
    assert alarms
    loaded = _compared(old, machine(write_bag, robot, seed=3, scale=0.85, payload_kg=100.0))
    changed = [c.name for c in loaded.changes if c.changed]
    assert changed == ["tilt_link.mcx"]
    assert loaded.base is not None
    assert loaded.base.test.outcome == CHANGED
    assert loaded.base.test.p_adjusted < 1e-6


@pytest.mark.needs("clarabel")
def test_a_bag_on_both_sides_is_said(
    crane_run, write_bag: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(crane_run.columns())
    old = tmp_path / "old" / "model.yaml"
    assert run([str(bag), "--robot", "xs031", "--out", str(old.parent)]) == 0
    kept = read_statistics(old)
    assert list(kept.bags.values()) == [bag.name]
    assert kept.dof["tilt_link.mcx"] >= 1.0
    # Nothing is left out of this model: residuals are the sensors' noise.
    assert kept.model_error == {}
    capsys.readouterr()
    arguments = [str(bag), "--robot", "xs031", "--compare", str(old)]
    assert run([*arguments, "--out", str(tmp_path / "new")]) == 0
    said = capsys.readouterr().out
    assert f"was identified from {bag.name}, too" in said
    assert "no parameter changed" in said


def _rows(time: np.ndarray) -> Rows:
    return Rows(np.zeros((time.size, 1)), np.zeros((time.size, 1, 1)), time, "run#0")


@pytest.mark.parametrize("cutoff", [10.0, 2.5, 0.5])
def test_the_guard_is_as_long_as_the_filter_carries(cutoff: float) -> None:
    split = HoldOut.of({"run": 600.0}, every=5, parallel_hz=cutoff)
    time = np.arange(0.0, 600.0, 0.05)
    rows = _rows(time)
    held, kept = split.held_out(rows).time_s, split.training(rows).time_s
    gaps = np.abs(kept[:, None] - held[None, ::5])
    assert gaps.min() > 3.0 / cutoff - 0.1
    # Half of the recording at least is fitted, and a fifth scored.
    assert kept.size > 0.5 * time.size
    assert held.size == pytest.approx(0.2 * time.size, rel=0.1)


@pytest.mark.parametrize("period_s", [12.0, 16.0, 20.0, 24.0, 40.0])
def test_no_part_of_a_motion_that_repeats_is_always_held_out(period_s: float) -> None:
    """Nor always fitted: each eighth of the motion is held out at times, and fitted at others."""
    split = HoldOut.of({"run": 600.0}, every=5)
    time = np.arange(0.0, 600.0, 0.05)
    eighth = np.floor(8.0 * np.mod(time, period_s) / period_s).astype(int)
    held = split.holds("run", time)
    share = np.bincount(eighth[held], minlength=8) / np.bincount(eighth, minlength=8)
    assert share.min() > 0.05
    assert share.max() < 0.5
    assert held.mean() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("every", [2, 3, 4, 5, 7])
def test_each_set_has_one_block_of_every_round(every: int) -> None:
    sets = in_turns(np.arange(every * every), every).reshape(every, every)
    for one in (sets, sets.T) if every % 2 or every == 4 else (sets,):
        assert (np.sort(one, axis=1) == np.arange(every)).all()


def test_blocks_shorter_than_the_guard_do_not_slip_through() -> None:
    split = HoldOut({"run": 0.5}, every=20, guard_s=1.5)
    time = np.arange(0.0, 60.0, 0.02)
    rows = _rows(time)
    held, kept = split.held_out(rows).time_s, split.training(rows).time_s
    assert kept.size > 0
    assert np.abs(kept[:, None] - held[None]).min() > 1.4


@pytest.mark.parametrize(
    ("option", "text"),
    [
        (["--filter-order", "0"], "filter order of 1 or more, found 0"),
        (["--decimation", "-1"], "decimation of 1 or more"),
        (["--parallel-cutoff", "0"], "parallel cut-off above 0 Hz, found 0"),
        (["--differentiation-cutoff", "-5"], "differentiation cut-off above 0 Hz, found -5"),
    ],
)
def test_a_wrong_filter_option_alone_is_named(option: list[str], text: str) -> None:
    options = parser().parse_args(["bag", "--robot", "xs031", "--out", "out", *option])
    with pytest.raises(IdentError) as error:
        settings_of(options)
    assert text in str(error.value)
    assert " and " not in str(error.value)
