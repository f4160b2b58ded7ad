"""From voltages to a model file: simulated recordings, bags, result files and exit codes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.bag.recording import Recording
from hydro_ident.commands.identify import main, run, write_results
from hydro_ident.errors import IdentError
from hydro_ident.identification import Identification, identify
from hydro_ident.report.identification_report import report_html
from hydro_ident.results import OWN_FILES, Provenance, result_dict, write_together
from hydro_model.base_parameters import base_map
from hydro_model.cylinder import lever
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulate import simulate

H = 0.002
ORIGIN = Provenance("identify bag", "1.0", "xs031", {"bag": "00"}, {})
EFFECTS = (
    EffectSpec("coulomb_friction", "xs031", {"force": 2500.0, "velocity_scale": 0.005}),
    EffectSpec("valve_null_bias", "tilt_valve", {"bias": 0.006}),
    EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 4e-13}),
    EffectSpec("dead_volume", "tilt_cylinder", {"volume_a": 9e-4, "volume_b": 1.1e-3}),
)


@dataclass(frozen=True)
class Run:
    """A simulated run: voltages in, noise-free samples out."""

    robot: Robot
    voltage: np.ndarray
    q: np.ndarray
    p_a: np.ndarray
    p_b: np.ndarray

    def recording(self, name: str = "run", **changes: object) -> Recording:
        count = len(self.q)
        rail = np.full(count, 1.0)
        given = Recording(
            path=Path(name),
            robot=load_robot("xs031"),
            stamp_ns=10**18 + np.arange(count) * 2_000_000,
            period_s=H,
            q=self.q,
            stroke=None,
            effort=None,
            p_a=self.p_a,
            p_b=self.p_b,
            supply=self.robot.supply_pressure_pa * rail,
            tank=self.robot.tank_pressure_pa * rail,
            valve_v=self.voltage,
            valve_source="/valve_state",
            command_v=self.voltage,
            spool=None,
            latched=np.zeros(count, dtype=bool),
            q_ref=None,
            qd_ref=None,
            force_ref=None,
            tip_ref=None,
            temperature_stamp_ns=None,
            temperature_c=None,
            losses=(),
            gaps=(),
            duplicates={},
            notes=(),
            metadata={},
        )
        return replace(given, **changes)  # type: ignore[arg-type]


def _true_robot(effects: tuple[EffectSpec, ...] = ()) -> Robot:
    robot = load_robot("xs031")
    inertia = robot.link_inertia.copy()
    inertia[0] *= 0.9
    inertia[1] *= 1.12
    friction, bulk = (3.2e4, 4.1e4), (8.2e8, 7.4e8)
    edges = ((7.9e-7, 9.3e-7, 8.1e-7, 9.6e-7), (9.4e-7, 7.8e-7, 9.9e-7, 8.4e-7))
    return replace(
        robot,
        link_inertia=inertia,
        cylinders=tuple(
            replace(c, viscous_friction=b, bulk_modulus_pa=k)
            for c, b, k in zip(robot.cylinders, friction, bulk, strict=True)
        ),
        valves=tuple(
            replace(v, c_pa=a, c_at=b, c_pb=c, c_bt=d)
            for v, (a, b, c, d) in zip(robot.valves, edges, strict=True)
        ),
        command_delay_s=0.0013,
        effects=effects,
    )


def _wanted(t: float) -> np.ndarray:
    fade = np.clip(t / 2.0, 0.0, 1.0)
    fade = fade * fade * (3.0 - 2.0 * fade)
    lift = 0.35 * np.sin(2 * np.pi * 0.11 * t) + 0.006 * np.sin(2 * np.pi * (0.5 + 0.03 * t) * t)
    tilt = 0.50 * np.sin(2 * np.pi * 0.17 * t) + 0.008 * np.sin(2 * np.pi * (0.6 + 0.03 * t) * t)
    return np.array([0.55, -1.2]) + fade * np.array([lift, tilt])


def _simulate(robot: Robot, seconds: float) -> Run:
    """Drive the model along a wanted motion by a slow loop, then roll it out in one piece."""
    time = np.arange(round(seconds / H) + 1) * H
    voltage = np.zeros((time.size, 2))
    instant = replace(robot, command_delay_s=0.0)
    q, qd, pressures = _wanted(0.0), np.zeros(2), None
    for k in range(0, time.size - 1, 10):
        piece = slice(k, min(k + 11, time.size))
        ahead, later = _wanted(time[k] + 0.02), _wanted(time[k] + 0.021)
        for i, cylinder in enumerate(robot.cylinders):
            speed = (later[i] - ahead[i]) / 0.001 + 2.0 * (ahead[i] - q[i])
            flow = float(lever(cylinder, q[i])) * speed * cylinder.area_a_m2
            voltage[piece, i] = np.clip(10.0 * flow / (9e-7 * 2800.0), -9.0, 9.0)
        out = simulate(instant, time[piece], voltage[piece], q, qd, pressures)
        q, qd = out.q[-1], out.qd[-1]
        pressures = np.stack([out.p_a[-1], out.p_b[-1]], axis=1)
    out = simulate(robot, time, voltage, _wanted(0.0))
    return Run(robot, voltage, out.q, out.p_a, out.p_b)


@pytest.fixture(scope="module")
def clean() -> Run:
    return _simulate(_true_robot(), 18.0)


@pytest.fixture(scope="module")
def found(clean: Run) -> Identification:
    return identify(load_robot("xs031"), [clean.recording()])


def _truth(robot: Robot) -> dict[str, float]:
    base = base_map(robot)
    values = dict(zip(base.names, base.combination @ robot.parameter_vector, strict=True))
    for c in robot.cylinders:
        values[f"{c.name}.viscous_friction"] = c.viscous_friction
        values[f"{c.name}.bulk_modulus"] = c.bulk_modulus_pa
    for v in robot.valves:
        values |= {f"{v.name}.{e}": getattr(v, e) for e in ("c_pa", "c_at", "c_pb", "c_bt")}
    return values | {"command_delay": robot.command_delay_s}


def test_noise_free_samples_give_every_parameter_to_1e3(found: Identification, clean: Run) -> None:
    truth = _truth(clean.robot)
    assert found.verdict == "identified"
    assert {p.name for p in found.parameters} == set(truth)
    for p in found.parameters:
        # The smallest moment is known to what the largest one is known to.
        slack = 0.02 if p.unit == "kg m" else 0.0
        assert p.value == pytest.approx(truth[p.name], rel=2e-3, abs=slack), p.name
        assert p.identifiable or p.reason.startswith("below detection"), p.name
    for channel in found.channels:
        assert channel.summary()["fit_after_pct"] > 99.9  # type: ignore[operator]


def test_noise_leaves_the_truth_within_the_stated_deviations(clean: Run) -> None:
    rng, count = np.random.default_rng(7), 2 * np.pi / 2**20
    noisy = clean.recording(
        q=count * np.round(clean.q / count + rng.normal(0, 0.5, clean.q.shape)),
        p_a=1e3 * np.round(clean.p_a / 1e3 + rng.normal(0, 4, clean.p_a.shape)),
        p_b=1e3 * np.round(clean.p_b / 1e3 + rng.normal(0, 4, clean.p_b.shape)),
    )
    result = identify(load_robot("xs031"), [noisy])
    truth = _truth(clean.robot)
    for p in result.parameters:
        assert abs(p.value - truth[p.name]) < 5.0 * p.std, p.name
    for channel in result.channels:
        s = channel.summary()
        assert s["rmse_after"] == pytest.approx(s["noise_floor"], rel=0.4)


def test_listed_effects_are_fitted_and_none_is_added() -> None:
    run_ = _simulate(_true_robot(EFFECTS), 18.0)
    listed = tuple(
        replace(
            e,
            parameters={
                k: v if k == "velocity_scale" else 0.5 * v for k, v in e.parameters.items()
            },
        )
        for e in EFFECTS
    )
    result = identify(replace(load_robot("xs031"), effects=listed), [run_.recording()])
    values = {p.name: p for p in result.parameters}
    for name, value in {
        "lift_cylinder.coulomb_friction.force": 2500.0,
        "tilt_cylinder.coulomb_friction.force": 2500.0,
        "lift_cylinder.internal_leakage.coefficient": 4e-13,
        "tilt_cylinder.dead_volume.volume_a": 9e-4,
        "tilt_cylinder.dead_volume.volume_b": 1.1e-3,
        "tilt_cylinder.valve_null_bias.bias": 0.006,
        "tilt_cylinder.bulk_modulus": 7.4e8,
    }.items():
        assert values[name].value == pytest.approx(value, rel=0.02), name
    assert result.robot is not None
    friction = [e for e in result.robot.effects if e.name == "coulomb_friction"]
    assert {e.target for e in friction} == {"lift_cylinder", "tilt_cylinder"}
    assert friction[0].parameters["velocity_scale"] == 0.005
    assert len(result.robot.effects) == 5


def test_a_stuck_joint_is_not_enough_data_and_named(clean: Run) -> None:
    stuck = clean.q.copy()
    stuck[:, 1] = stuck[0, 1]
    result = identify(load_robot("xs031"), [clean.recording(q=stuck)])
    assert result.verdict == "not_enough_data"
    assert result.robot is None
    assert "tilt_cylinder.viscous_friction" in result.problems[0]
    assert "tilt did not move" in result.problems[0]


def test_no_voltages_identify_the_links_and_say_the_rest(clean: Run) -> None:
    result = identify(load_robot("xs031"), [clean.recording(valve_v=None, command_v=None)])
    assert result.verdict == "partly_identified"
    assert {c.name for c in result.channels} == {"lift/force", "tilt/force"}
    assert len(result.problems) == 2
    assert "no flow channel was recorded" in result.problems[0]
    assert result.robot is not None
    assert result.robot.valves == load_robot("xs031").valves


def test_a_rejected_stage_keeps_the_given_numbers_and_says_so(clean: Run) -> None:
    crossed = clean.recording(valve_v=clean.voltage * np.array([1.0, -1.0]))
    result = identify(load_robot("xs031"), [crossed])
    assert result.verdict == "partly_identified"
    assert any("hydraulics of tilt_cylinder rejected" in text for text in result.problems)
    given = load_robot("xs031")
    assert result.robot is not None
    assert result.robot.valves[1] == given.valves[1]
    assert result.robot.cylinders[1].bulk_modulus_pa == given.cylinders[1].bulk_modulus_pa
    assert not any(p.identifiable for p in result.parameters if p.name.startswith("tilt_valve"))


def test_no_pressures_no_effort_is_not_enough_data(clean: Run) -> None:
    result = identify(load_robot("xs031"), [clean.recording(p_a=None, p_b=None)])
    assert result.verdict == "not_enough_data"
    assert "no force channel" in result.problems[0]


def test_a_gap_splits_the_recording_and_spoils_nothing(clean: Run) -> None:
    keep = np.ones(len(clean.q), dtype=bool)
    keep[6000:6200] = False
    recording = clean.recording()
    cut = {
        name: getattr(recording, name)[keep]
        for name in ("stamp_ns", "q", "p_a", "p_b", "supply", "tank", "valve_v", "latched")
    }
    result = identify(load_robot("xs031"), [replace(recording, command_v=None, **cut)])
    truth = _truth(clean.robot)
    for p in result.parameters:
        slack = 0.02 if p.unit == "kg m" else 0.0
        assert p.value == pytest.approx(truth[p.name], rel=2e-3, abs=slack), p.name


def test_validation_bags_give_the_scores(clean: Run) -> None:
    other = clean.recording("other", latched=np.ones(len(clean.q), dtype=bool))
    result = identify(load_robot("xs031"), [clean.recording()], [other])
    assert {c.name for c in result.channels} == {"lift/force", "tilt/force"}
    assert all(c.recordings == ("other",) for c in result.channels)


def test_the_result_has_the_keys_of_the_contract(found: Identification) -> None:
    result = json.loads(json.dumps(result_dict(found, ORIGIN)))
    assert result["schema"] == "hydro_ident/identification/1"
    keys = {"name", "value", "std", "ci95", "unit", "datasheet", "identifiable", "model_error"}
    for p in result["parameters"]:
        assert keys <= set(p)
        if p["held"]:
            assert (p["identifiable"], p["std"], p["ci95"]) == (False, None, None)
        else:
            assert p["ci95"][0] < p["value"] < p["ci95"][1]
    assert any(p["held"] for p in result["parameters"])
    first = result["parameters"][0]
    assert first["combination"]["lift_link.mcx"] == 1.0
    assert first["combination"]["tilt_link.mass"] == pytest.approx(1.6)
    # Masses that move with the joints hang on their pins.
    assert first["combination"]["tilt_cylinder_rod.mass"] == pytest.approx(1.6)
    friction = next(p for p in result["parameters"] if p["name"].endswith("viscous_friction"))
    assert friction["datasheet"] is None
    keys = {"rmse_before", "rmse_after", "noise_floor", "fit_before_pct", "fit_after_pct", "unit"}
    joints = ("lift", "tilt")
    names = {f"{j}/{k}" for j in joints for k in ("force", "flow_a", "flow_b")}
    assert set(result["channels"]) == names
    assert all(keys <= set(channel) for channel in result["channels"].values())


def test_the_same_bag_gives_the_same_text(found: Identification, clean: Run) -> None:
    again = identify(load_robot("xs031"), [clean.recording()])
    assert json.dumps(result_dict(again, ORIGIN)) == json.dumps(result_dict(found, ORIGIN))


def test_the_model_predicts_exactly_what_the_identification_did(
    found: Identification, tmp_path: Path
) -> None:
    write_results(found, ORIGIN, tmp_path / "out")
    model = load_robot(tmp_path / "out" / "model.yaml")
    assert found.robot is not None
    assert np.array_equal(model.link_inertia, found.robot.link_inertia)
    assert model.cylinders == found.robot.cylinders
    assert model.valves == found.robot.valves
    assert model.command_delay_s == found.robot.command_delay_s
    assert np.array_equal(model.base_covariance, found.robot.base_covariance)


class _Reader(HTMLParser):
    """Collects what a page would fetch, and checks that its tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [v or "" for k, v in attrs if k in ("src", "href")]
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [v or "" for k, v in attrs if k in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_report_is_one_file_that_fetches_nothing(
    found: Identification, tmp_path: Path
) -> None:
    write_results(found, ORIGIN, tmp_path / "out")
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    reader = _Reader()
    reader.feed(text)
    assert reader.open == []
    assert all(address.startswith("#") for address in reader.fetched)
    assert "lift_link.mcx + 1.6 tilt_link.mass" in text


def test_a_failure_while_writing_leaves_the_old_result(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_together(out, lambda d: (d / "result.json").write_text("old") and None)

    def fails(folder: Path) -> None:
        (folder / "result.json").write_text("new")
        raise OSError(28, "No space left on device")

    with pytest.raises(IdentError, match="No space left"):
        write_together(out, fails)
    assert (out / "result.json").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_new_verdict_does_not_stand_beside_an_old_model(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("kept")
    for name in OWN_FILES:
        (out / name).write_text("old")
    write_together(out, lambda d: (d / "result.json").write_text("new") and None)
    assert sorted(p.name for p in out.iterdir()) == ["mine.txt", "result.json"]


@pytest.fixture
def bag(clean: Run, write_bag: Callable[..., Path]) -> Path:
    robot, count = clean.robot, len(clean.q)
    gauge = np.zeros((count, 6))
    gauge[:, 0:4:2], gauge[:, 1:4:2] = clean.p_a, clean.p_b
    gauge[:, 4], gauge[:, 5] = robot.supply_pressure_pa, robot.tank_pressure_pa
    columns = {
        "/joint_states": (robot.joint_names, {"position": clean.q}),
        "/chamber_pressures": (
            robot.pressure_names,
            {"effort": gauge + robot.atmospheric_pressure_pa},
        ),
        "/valve_state": (robot.valve_names, {"effort": clean.voltage}),
    }
    return write_bag(columns, name="excitation")


def test_where_it_is_written_does_not_change_the_result(bag: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        assert run([str(bag), "--robot", "xs031", "--out", str(tmp_path / name)]) == 0
    one, two = ((tmp_path / n / "result.json").read_bytes() for n in ("one", "two"))
    assert one == two


def test_the_command_writes_every_file_from_a_bag(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], clean: Run
) -> None:
    out = tmp_path / "results"
    assert run([str(bag), "--robot", "xs031", "--out", str(out)]) == 0
    assert "verdict: identified" in capsys.readouterr().out
    assert sorted(p.name for p in out.iterdir()) == sorted([*OWN_FILES, "xs031.urdf"])
    result = json.loads((out / "result.json").read_text())
    values = {p["name"]: p["value"] for p in result["parameters"]}
    assert values["lift_valve.c_pa"] == pytest.approx(7.9e-7, rel=1e-3)
    assert result["provenance"]["bags"][0]["name"] == "excitation"
    controller = yaml.safe_load((out / "controller.yaml").read_text())
    parameters = controller["controller"]["ros__parameters"]
    assert parameters["robot"] == str(out / "model.yaml")
    assert load_robot(parameters["robot"]).base_parameters
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert model["provenance"]["bags"] == result["provenance"]["bags"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing", "--robot", "xs031"], "missing"),
        (["missing", "--robot", "no_such_robot"], "no robot file 'no_such_robot'"),
    ],
)
def test_unreadable_input_is_one_line_and_writes_nothing(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["identify", *arguments, "--out", str(out)])
    assert main() == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_too_little_motion_exits_1_with_a_result_and_no_model(
    clean: Run,
    write_bag: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot, count = clean.robot, 3000
    still = np.repeat(clean.q[:1], count, axis=0)
    columns = {
        "/joint_states": (robot.joint_names, {"position": still}),
        "/chamber_pressures": (robot.pressure_names, {"effort": np.full((count, 6), 5e6)}),
        "/valve_state": (robot.valve_names, {"effort": np.zeros((count, 2))}),
    }
    path, out = write_bag(columns, name="rest"), tmp_path / "results"
    monkeypatch.setattr("sys.argv", ["identify", str(path), "--robot", "xs031", "--out", str(out)])
    assert main() == 1
    error = capsys.readouterr().err
    assert "lift_link.iyy" in error
    assert "lift, tilt did not move" in error
    assert sorted(p.name for p in out.iterdir()) == ["report.html", "result.json"]
    assert json.loads((out / "result.json").read_text())["verdict"] == "not_enough_data"


def test_bags_of_one_name_are_refused(clean: Run) -> None:
    with pytest.raises(IdentError, match="different names, found 'run'"):
        identify(clean.robot, [clean.recording(), clean.recording()])


def test_a_validation_bag_without_a_usable_stretch_scores_nothing(clean: Run) -> None:
    lost = clean.recording("lost", q=np.full_like(clean.q, np.nan))
    found = identify(clean.robot, [clean.recording()], [lost])
    assert found.channels == ()
    assert any("nothing was scored" in note for note in found.notes)


def test_residuals_far_above_the_noise_are_said() -> None:
    hidden = (EffectSpec("coulomb_friction", "xs031", {"force": 4000.0, "velocity_scale": 0.005}),)
    run = _simulate(_true_robot(hidden), 12.0)
    noise = np.random.default_rng(3).normal(0.0, 4000.0, (2, *run.p_a.shape))
    rough = run.recording(p_a=run.p_a + noise[0], p_b=run.p_b + noise[1])
    found = identify(load_robot("xs031"), [rough])
    [note] = [note for note in found.notes if "physics is left out" in note]
    assert "lift/force" in note
    assert "tilt/force" in note
    marked = {p.name: p.model_error for p in found.parameters}
    assert marked["lift_link.mcx"]
    assert marked["tilt_cylinder.viscous_friction"]
    assert not marked["lift_valve.c_pa"]
    assert not marked["command_delay"]
    report = report_html(found, ORIGIN.as_dict())
    assert report.count("physics is left out") == 1
    assert report.index("physics is left out") < report.index("stands for lift_link.mcx + 1.6")
