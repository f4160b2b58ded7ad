"""Free-run validation on held-out bags, and comparison with an earlier model."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.bag.recording import read_recording
from hydro_ident.commands.identify import run
from hydro_ident.errors import IdentError
from hydro_ident.estimate.forces.force_rows import force_model
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.compare import LEVEL, compare
from hydro_ident.identify.validation_results import rollout_lines
from hydro_ident.parameters.parameters import Parameter
from hydro_ident.rollouts.free_run import free_run
from hydro_ident.rollouts.rollout_windows import rolled_out, usable_pieces
from hydro_model.robot import BaseParameter, EffectSpec, Robot
from hydro_model.robot_files import load_robot

WHOLE = HoldOut(every=0)
EDGES = ("c_pa", "c_at", "c_pb", "c_bt")


@pytest.fixture(scope="session")
def other_run(make_run) -> object:
    """Another motion of the same crane, in which nothing changed."""
    true_crane, simulated_run = make_run
    return simulated_run(true_crane(), 18.0, seed=1)


@pytest.fixture(scope="session")
def loaded_run(make_run) -> object:
    """The crane with 60 kg more at its tip."""
    true_crane, simulated_run = make_run
    return simulated_run(true_crane(payload_kg=60.0), 18.0, seed=2)


def identified(bag: Path, out: Path, *more: str) -> dict:
    assert run([str(bag), "--robot", "xs031", "--out", str(out), *more]) == 0
    return json.loads((out / "result.json").read_text())


@pytest.mark.needs("clarabel", "plotly")
def test_the_identified_robot_runs_freely_on_a_held_out_bag(
    crane_run, other_run, write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    train = write_bag(crane_run.columns(), name="train")
    check = write_bag(other_run.columns(), name="check")
    result = identified(train, tmp_path / "out", "--validate", str(check))
    assert result["verdict"] == "identified"
    assert result["free_run"]["whole_runs"] == 1
    assert result["free_run"]["windows"] >= 6
    for joint in ("lift", "tilt"):
        channel = result["channels"][f"{joint}/force"]
        assert channel["rollout_unit"] == "rad"
        assert channel["rollout_rmse_after"] < 2e-3
        assert channel["rollout_rmse_after"] < 0.3 * channel["rollout_rmse_before"]
        assert channel["rollout_whole_run_rmse_after"] < 0.02
        flow = result["channels"][f"{joint}/flow_a"]
        assert all(flow[key] == channel[key] for key in channel if key.startswith("rollout"))
    report = (tmp_path / "out" / "report.html").read_text()
    assert "Free run from the recorded inputs" in report
    assert "lift, free run" in report


def test_the_true_robot_follows_its_recording_and_a_wrong_one_does_not(
    crane_run, write_bag: Callable[..., Path]
) -> None:
    bag = write_bag(crane_run.columns())
    truth = crane_run.robot
    traces = traces_of([read_recording(bag, truth)])
    stiff = replace(
        truth, valves=tuple(replace(v, c_pa=2.0 * v.c_pa, c_at=2.0 * v.c_at) for v in truth.valves)
    )
    result = free_run(stiff, truth, traces, WHOLE)
    assert result.rejected == ()
    for joint in result.joints:
        assert joint.rmse_after is not None
        assert joint.rmse_before is not None
        assert joint.rmse_after < 1e-3
        assert joint.rmse_before > 5.0 * joint.rmse_after
        assert joint.whole_after is not None
    again = free_run(stiff, truth, traces, WHOLE)
    assert [j.rmse_after for j in again.joints] == [j.rmse_after for j in result.joints]


def test_a_recorded_oil_temperature_is_what_a_free_run_drifts_with(
    crane_run, write_bag: Callable[..., Path]
) -> None:
    """At the reference temperature nothing drifts, however long the recording warms up."""
    [trace] = traces_of([read_recording(write_bag(crane_run.columns()), crane_run.robot)])
    trace = replace(trace, oil_c=np.full(len(trace.time_s), 40.0))
    piece = usable_pieces(crane_run.robot, trace, FilterSettings())[0]
    piece = replace(piece, end=min(piece.end, piece.begin + 500))
    drift = {"viscous": 2e4, "reference": 40.0, "warm_s": 300.0}
    warming = EffectSpec("temperature_drift", "lift_cylinder", drift)
    robot = replace(crane_run.robot, effects=(*crane_run.robot.effects, warming))
    plain = rolled_out(crane_run.robot, piece).q
    np.testing.assert_allclose(rolled_out(robot, piece).q, plain, rtol=0, atol=1e-9)
    unknown = replace(piece, trace=replace(trace, oil_c=None))
    assert np.abs(rolled_out(robot, unknown).q - plain).max() > 1e-6


def test_only_held_out_blocks_are_run(crane_run, write_bag: Callable[..., Path]) -> None:
    bag = write_bag(crane_run.columns())
    [trace] = traces_of([read_recording(bag, crane_run.robot)])
    name = trace.label.rsplit("#", 1)[0]
    result = free_run(crane_run.robot, None, [trace], HoldOut({name: 3.0}, 3))
    assert result.whole_runs == 0
    for time in (result.joints[0].time_s, result.joints[1].time_s):
        assert set(np.floor(time / 3.0).astype(int)) == {2, 3}
    assert result.joints[0].rmse_after is None


def test_a_roll_out_that_fails_is_rejected_and_said(
    crane_run, write_bag: Callable[..., Path]
) -> None:
    bag = write_bag(crane_run.columns())
    truth = crane_run.robot
    traces = traces_of([read_recording(bag, truth)])
    leaking = replace(
        truth, effects=(EffectSpec("constant_force_offset", "tilt_cylinder", {"force": 1e5}),)
    )
    result = free_run(truth, leaking, traces, WHOLE)
    assert result.joints[0].rmse_after is None
    assert result.joints[0].rmse_before is not None
    assert "free run of the identified robot rejected: bag from" in result.failed
    assert "left its stroke" in result.failed
    # Degrees stand behind the size that they are, not behind the one that there is none of.
    line = rollout_lines(result)[0]
    assert re.search(r"RMSE +[\d.e-]+ rad \([\d.e-]+ deg\) -> +rejected$", line), line


def changes(result: dict) -> dict[str, dict]:
    return {row["name"]: row for row in result["compare"]["parameters"]}


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
def test_nothing_changed_is_not_called_a_change(
    crane_run, other_run, write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    identified(write_bag(crane_run.columns(), name="old"), tmp_path / "old")
    model = tmp_path / "old" / "model.yaml"
    new = write_bag(other_run.columns(), name="new")
    result = identified(new, tmp_path / "new", "--compare", str(model))
    found = changes(result)
    for name in ("tilt_cylinder.viscous_friction", "lift_cylinder.bulk_modulus", "command_delay"):
        assert found[name]["old_std_known"], name
    share = np.mean([row["changed"] for row in found.values()])
    assert share <= 0.15, [row["name"] for row in found.values() if row["changed"]]


@pytest.mark.thorough
@pytest.mark.needs("clarabel", "plotly")
def test_a_payload_is_found_and_named(
    crane_run, loaded_run, write_bag: Callable[..., Path], tmp_path: Path, capsys
) -> None:
    identified(write_bag(crane_run.columns(), name="old"), tmp_path / "old")
    model = tmp_path / "old" / "model.yaml"
    assert "lift_valve.c_pa" in yaml.safe_load(model.read_text())["standard_deviations"]
    new = write_bag(loaded_run.columns(), name="new")
    capsys.readouterr()
    result = identified(new, tmp_path / "new", "--compare", str(model))
    found = changes(result)
    reach = float(crane_run.robot.tip_offset_m[0])
    moment = found["tilt_link.mcx"]
    assert moment["changed"]
    assert moment["change"] == pytest.approx(60.0 * reach, rel=0.1)
    assert moment["p_adjusted"] < 1e-6
    assert result["compare"]["base_parameters"]["p_value"] < 1e-6
    text = capsys.readouterr().out
    assert f"compared with {model}" in text
    assert "CHANGED" in text
    assert "Changes since the earlier model" in (tmp_path / "new" / "report.html").read_text()


def parameter(name: str, value: float, std: float = 1.0) -> Parameter:
    return Parameter(name, value, std, "N", None, True)


def test_significance_is_that_of_both_sides_and_of_many_tests(robot: Robot) -> None:
    friction = (100.0, 200.0)
    names = [f"{c.name}.viscous_friction" for c in robot.cylinders]
    old = replace(
        robot,
        cylinders=tuple(
            replace(c, viscous_friction=b) for c, b in zip(robot.cylinders, friction, strict=True)
        ),
        standard_deviations={names[0]: 3.0, names[1]: 1e-6},
    )
    new = [parameter(names[0], 112.5, 4.0), parameter(names[1], 208.8, 4.0)]
    result = compare(old, robot, new, "old.yaml")
    first, second = result.changes
    assert (first.std, first.z) == (5.0, pytest.approx(2.5))
    assert first.test is not None
    assert second.test is not None
    assert first.test.p_value == pytest.approx(0.012419, rel=1e-4)
    assert second.z == pytest.approx(2.2)
    assert second.test.p_value == pytest.approx(0.027807, rel=1e-4)
    # Holm: the smallest times two, the next as it is but not below the first.
    assert first.test.p_adjusted == pytest.approx(2 * 0.012419, rel=1e-4)
    assert second.test.p_adjusted == pytest.approx(0.027807, rel=1e-4)
    assert first.changed
    assert second.changed
    assert LEVEL == 0.05
    assert result.notes == ()
    alone = replace(old, standard_deviations={names[0]: 3.0})
    rest = compare(alone, robot, new, "old.yaml")
    assert [c.name for c in rest.changes] == names[:1]
    assert rest.notes == (f"{names[1]}: not identified in old.yaml, not compared",)


def test_false_alarms_stay_below_the_level(robot: Robot) -> None:
    """300 comparisons of two unchanged machines, 10 parameters each."""
    rng = np.random.default_rng(11)
    edges = [f"{v.name}.{e}" for v in robot.valves for e in EDGES]
    names = [*edges, *(f"{c.name}.viscous_friction" for c in robot.cylinders)]
    alarms = 0
    for _ in range(300):
        draw = dict(zip(names, rng.normal(size=(len(names), 2)), strict=True))
        old = replace(
            robot,
            valves=tuple(
                replace(v, **{e: draw[f"{v.name}.{e}"][0] for e in EDGES}) for v in robot.valves
            ),
            cylinders=tuple(
                replace(c, viscous_friction=draw[f"{c.name}.viscous_friction"][0])
                for c in robot.cylinders
            ),
            standard_deviations=dict.fromkeys(names, 1.0),
        )
        new = [parameter(name, draw[name][1]) for name in names]
        alarms += any(c.changed for c in compare(old, robot, new, "old").changes)
    # 15 expected at 5 %, standard deviation 3.8.
    assert 2 <= alarms <= 28


@pytest.mark.needs("clarabel")
def test_a_model_of_another_machine_is_refused(
    crane_run, write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag = write_bag(crane_run.columns())
    arguments = [str(bag), "--robot", "xs031", "--out", str(tmp_path / "out"), "--compare", "emps"]
    with pytest.raises(IdentError, match="expected a model of the same machine with joints lift"):
        run(arguments)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("field", "off"),
    [("bore_m", 2e-5), ("l1_m", 2e-3), ("q0_rad", 0.02), ("child_pin_angle_rad", 0.3)],
)
def test_another_cylinder_under_the_same_name_is_refused(field: str, off: float) -> None:
    robot = load_robot("xs031")
    lift, tilt = robot.cylinders
    other = replace(lift, **{field: getattr(lift, field) + off})
    with pytest.raises(IdentError, match=f"found lift_cylinder with {field}"):
        compare(replace(robot, cylinders=(other, tilt)), robot, [], "old")
    # Oil, friction and bodies are what is compared.
    changed = replace(lift, bulk_modulus_pa=9e8, viscous_friction=1.0, barrel=None)
    assert not compare(replace(robot, cylinders=(changed, tilt)), robot, [], "old").changes


def _parameters(robot: Robot) -> list[Parameter]:
    base = force_model(robot).base
    return [
        replace(parameter(name, 1.0), combination=base.coefficients(i))
        for i, name in enumerate(base.names)
    ]


@pytest.mark.parametrize(
    ("field", "off"), [("q0_rad", 2e-6), ("q0_rad", 5e-4), ("child_pin_angle_rad", 5e-4)]
)
def test_pins_calibrated_again_are_compared_and_said(field: str, off: float) -> None:
    robot = load_robot("xs031")
    lift, tilt = robot.cylinders
    moved = replace(tilt, **{field: getattr(tilt, field) + off})
    old = replace(robot, cylinders=(lift, moved))
    base = [BaseParameter(p.name, p.combination, 1.0) for p in _parameters(old)]
    found = compare(replace(old, base_parameters=tuple(base)), robot, _parameters(robot), "old")
    assert len(found.changes) == len(base)
    [note] = [n for n in found.notes if "near enough" in n]
    here, there = (getattr(c, field) for c in (tilt, moved))
    assert note.startswith(f"tilt_cylinder: {field} {here:.9g}, {there:.9g} there (old)")


@pytest.mark.parametrize("field", ["bore_m", "x0_m"])
def test_micrometres_are_the_same_cylinder_and_said(field: str) -> None:
    robot = load_robot("xs031")
    lift, tilt = robot.cylinders
    other = replace(lift, **{field: getattr(lift, field) + 2e-6})
    found = compare(replace(robot, cylinders=(other, tilt)), robot, [], "old")
    assert found.changes == ()
    [note] = found.notes
    assert note.startswith(f"lift_cylinder: {field} ")
    assert "near enough to be compared" in note


def test_the_pins_direction_counts_where_bodies_hang_on_it(robot: Robot) -> None:
    bare = [replace(c, barrel=None, rod=None) for c in robot.cylinders]
    turned = [replace(c, child_pin_angle_rad=c.child_pin_angle_rad + 0.3) for c in bare]
    old, new = (replace(robot, cylinders=tuple(some)) for some in (turned, bare))
    assert not compare(old, new, [], "old").notes


@pytest.mark.needs("clarabel")
def test_a_datasheet_can_be_compared_too(
    crane_run, write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    result = identified(write_bag(crane_run.columns()), tmp_path / "out", "--compare", "xs031")
    found = changes(result)
    bulk = found["lift_cylinder.bulk_modulus"]
    assert not bulk["old_std_known"]
    assert bulk["old"] == load_robot("xs031").cylinders[0].bulk_modulus_pa
    assert result["compare"]["base_parameters"] is None
    assert any("no standard deviations" in note for note in result["compare"]["notes"])


def test_a_long_bag_is_run_in_parts(
    crane_run, write_bag: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag(crane_run.columns())
    traces = traces_of([read_recording(bag, crane_run.robot)])
    monkeypatch.setattr("hydro_ident.rollouts.free_run.MOST_WINDOWS", 3)
    monkeypatch.setattr("hydro_ident.rollouts.free_run.MOST_WHOLE_S", 4.0)
    result = free_run(crane_run.robot, crane_run.robot, traces, WHOLE)
    assert (result.windows, result.whole_runs) == (3, 1)
    gaps = np.diff(result.joints[0].time_s)
    assert int(np.sum(gaps > 1.0)) == 2
