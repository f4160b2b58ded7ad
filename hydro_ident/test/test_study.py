"""The concealed-physics study: what is hidden shows where it should, and nothing tells of it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.rig.extras import Extras
from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_ident.bag.recording import read_recording
from hydro_ident.commands.study import frozen_seed, one_case, run
from hydro_ident.design.limits import fits
from hydro_ident.errors import IdentError
from hydro_ident.experiment import LIMITS
from hydro_ident.study.conceal import ANSWERS, CASES, TRUTHS, diagnose_case, write_case, write_json
from hydro_ident.study.detection_limit import (
    HALF_POWER,
    channel_names,
    detectability,
    noise_spectra,
)
from hydro_ident.study.experiments import Motion, work
from hydro_ident.study.generate import CaseSpec, kinds, make_case, truth_record
from hydro_ident.study.hidden import Machine, Scene, machine_extras
from hydro_ident.study.leaks import leak, outward
from hydro_ident.study.machines import random_crane
from hydro_ident.study.planting import KNOWN, OUTSIDE
from hydro_ident.study.robots import StudyRobot
from hydro_ident.study.seclusion import can_seclude
from hydro_ident.study.traces import EVERY, drive, nuisance, scene_of, thinned, trace
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots

POSE = np.array([0.7, -1.4])
#: What may show beside the channel an effect belongs to: its own cylinder's others, or all.
FORCE = {"force"}
FLOW = {"flow_a", "flow_b"}
EVERYWHERE = {
    *("payload_change", "base_tilt", "external_contact", "encoder_offset"),
    *("encoder_eccentricity", "structural_flexibility", "cylinder_inertia"),
    *("supply_droop", "tank_back_pressure", "entrained_air", "pump_ripple"),
    *("command_delay", "pressure_delay"),
}
BOTH = {"backlash", "pressure_sensor_bias", "pressure_sensor_gain", "sensor_hum"}


@pytest.fixture(scope="module")
def crane() -> Robot:
    """The reference crane without its cylinders' bodies in the file."""
    robot = load_robot("xs031")
    bare = tuple(replace(c, barrel=None, rod=None) for c in robot.cylinders)
    return replace(robot, cylinders=bare)


@pytest.fixture(scope="module")
def motion(crane: Robot) -> Motion:
    """Twelve seconds of both joints, with pauses, quick and slow."""
    t = np.arange(0.0, 12.0, 2e-3)[:, None]
    fade = np.clip(t / 1.5, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(t / 1.5, 0.0, 1.0))
    pause = np.where((t > 6.0) & (t < 7.0), 0.0, 1.0)
    rate = fade * pause * np.array([0.22, 0.4]) * np.cos(np.array([1.3, 1.9]) * t)
    rate += fade * pause * np.array([0.05, 0.07]) * np.cos(np.array([6.0, 7.0]) * t)
    q = POSE + np.cumsum(rate, axis=0) * 2e-3
    return Motion("excite", q, rate)


@pytest.fixture(scope="module")
def plain(crane: Robot) -> Machine:
    return Machine(crane, plain_truth(crane, 12), lines_recorded=False)


@pytest.fixture(scope="module")
def scene(plain: Machine, motion: Motion) -> Scene:
    return scene_of(drive(plain, motion, 1))


def test_plain_machine_leaves_no_trace(plain: Machine, motion: Motion) -> None:
    left = trace(drive(plain, motion, 1), plain)
    assert np.abs(left[:, 0::3]).max() < 1e-6
    assert np.abs(np.delete(left, [0, 3], axis=1)).max() < 1e-14


@pytest.mark.parametrize("name", [*KNOWN, *OUTSIDE])
def test_effect_shows_in_its_channel_and_in_no_other(
    name: str, plain: Machine, scene: Scene, motion: Motion
) -> None:
    hidden = (KNOWN | OUTSIDE)[name]
    assert hidden.needs(plain, 1)
    size = float(np.sqrt(hidden.low * hidden.high))
    machine = hidden.apply(plain, scene, 1, size, 3)
    left = trace(drive(machine, motion, 1), plain)
    sizes = np.sqrt(np.mean(left**2, axis=0)) / np.tile([1.0, 1e-7, 1e-7], 2)
    shown = {n for n, s in zip(channel_names(plain), sizes, strict=True) if s > 1e-3}
    assert shown, name
    if name in EVERYWHERE:
        return
    own = {n.split("/")[1] for n in shown if n.startswith("tilt/")}
    assert not any(n.startswith("lift/") for n in shown), shown
    in_force = name in BOTH or own == FORCE
    in_flow = name in BOTH or own <= FLOW
    assert in_force or in_flow, (name, shown)
    expected = "force" if "friction" in name or "force" in name else None
    assert expected is None or own == FORCE


@pytest.mark.parametrize("name", ["coulomb_friction", "dead_volume", "pressure_sensor_bias"])
def test_trace_grows_like_the_size(
    name: str, plain: Machine, scene: Scene, motion: Motion
) -> None:
    hidden, sizes = KNOWN[name], []
    for factor in (1.0, 2.0):
        size = 3.0 * hidden.low * factor
        run = drive(hidden.apply(plain, scene, 0, size, 5), motion, 1)
        sizes.append(detectability(run, plain, size, delay=True))
    assert sizes[1].limit == pytest.approx(sizes[0].limit, rel=0.1)
    assert sizes[1].noncentrality == pytest.approx(4.0 * sizes[0].noncentrality, rel=0.25)


def test_limit_is_where_the_best_test_has_half_power(
    plain: Machine, scene: Scene, motion: Motion
) -> None:
    """Monte Carlo: random forces on the piston, and the effect's trace at its limit."""
    hidden, size = KNOWN["coulomb_friction"], 100.0
    loud = machine_extras(plain, disturbance_n=300.0, disturbance_time_s=0.05)
    run = drive(hidden.apply(loud, scene, 0, size, 5), motion, 1)
    found = detectability(run, loud, size, delay=True)
    shape = trace(run, loud)[:, 0] * found.limit / size
    columns = nuisance(run, loud, delay=True)[0][: len(shape)]
    spectrum = noise_spectra(run, loud)[0]

    def white(values: np.ndarray) -> np.ndarray:
        spectral = np.fft.rfft(values, axis=0)
        return np.asarray(np.fft.irfft((spectral.T / np.sqrt(spectrum)).T, len(values), axis=0))

    basis, size_, _ = np.linalg.svd(white(columns), full_matrices=False)
    basis = basis[:, size_ > 1e-9 * size_[0]]
    direction = white(shape)
    direction -= basis @ (basis.T @ direction)
    direction /= np.linalg.norm(direction)
    random, hits, chance, tries = np.random.default_rng(4), 0, 0, 300
    steps, keep = len(shape) * EVERY, np.exp(-2e-3 / 0.05)
    from scipy.signal import lfilter

    for _ in range(tries):
        fresh = random.standard_normal(steps + 500) * 300.0 * np.sqrt(1.0 - keep**2)
        noise = thinned(lfilter([1.0], [1.0, -keep], fresh)[500:, None])[:, 0]
        hits += (direction @ white(noise + shape)) ** 2 > 6.635
        chance += (direction @ white(noise)) ** 2 > 6.635
    assert pytest.approx(6.63, abs=0.01) == HALF_POWER
    # The refit shares columns between the joints here: half power within sampling and that.
    assert 0.35 < hits / tries < 0.65
    assert chance / tries < 0.04


def test_kinds_have_their_shares_in_an_order_of_chance() -> None:
    counts = Counter(kinds(3, 750))
    assert sum(counts.values()) == 750
    assert (counts["clean"], counts["outside"]) == (300, 150)
    assert counts["single"] + counts["double"] + counts["triple"] == 300
    assert len(kinds(3, 12)) == 12
    assert kinds(3, 40) == kinds(3, 40)
    assert kinds(3, 40) != kinds(4, 40)


def test_random_cranes_read_back_and_differ(tmp_path: Path) -> None:
    robots = [random_crane(f"c{k}", k, tmp_path / str(k))[1] for k in range(6)]
    assert len({r.cylinders[0].bore_m for r in robots}) == 6
    assert {r.dof for r in robots} <= {1, 2, 3}
    again = random_crane("c0", 0, tmp_path / "again")[1]
    np.testing.assert_array_equal(again.link_inertia, robots[0].link_inertia)
    for robot in robots:
        plain_truth(robot, 1)


def test_work_goes_round_the_same_stations_within_the_limits(crane: Robot) -> None:
    train, check = work(crane, 3)
    assert (len(train.q), len(check.q)) == (30_000, 20_000)
    np.testing.assert_array_equal(work(crane, 3)[0].q, train.q)
    qdd = np.gradient(train.qd, 2e-3, axis=0)
    assert fits(crane, LIMITS, train.q[::10], train.qd[::10], 0.9 * qdd[::10])
    rests = train.q[500:][np.all(train.qd[500:] == 0.0, axis=1)]
    stations, visits = np.unique(np.round(rests, 6), axis=0, return_counts=True)
    assert 3 <= len(stations) <= 7
    # Held for 0.3 to 1.5 s each time: longer in all is more than once.
    assert np.sum(visits > 800) >= 2


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory, motion: Motion) -> tuple[Path, list[Any]]:
    """Four cases of one crane, with short motions in place of designed ones."""
    out = tmp_path_factory.mktemp("study")
    folder = out / "robots" / "00"
    folder.mkdir(parents=True)
    source = shipped_robots()["xs031"]
    text = source.read_text(encoding="utf-8").replace("xs031", "crane_00")
    (folder / "crane_00.hydraulics.yaml").write_text(text, encoding="utf-8")
    urdf = source.with_name("xs031.urdf").read_text(encoding="utf-8").replace("xs031", "crane_00")
    (folder / "crane_00.urdf").write_text(urdf, encoding="utf-8")
    robot = load_robot(folder / "crane_00.hydraulics.yaml")
    half = Motion("excite", motion.q[:3000], motion.qd[:3000])
    robots = [StudyRobot(folder, robot, (motion, half))]
    cases = []
    with pytest.MonkeyPatch.context() as patch:
        # Work cycles of a minute would take the test too long; they are another motion, no more.
        patch.setattr("hydro_ident.study.generate.work", lambda robot, seed: (motion, half))
        for index, kind in enumerate(("clean", "single", "double", "outside")):
            case = make_case(CaseSpec(5, index, kind), robots)  # type: ignore[arg-type]
            write_case(case, out)
            cases.append(case)
    return out, cases


def test_case_follows_from_its_seed(study: tuple[Path, list[Any]], tmp_path: Path) -> None:
    out, cases = study
    case = cases[1]
    write_case(case, tmp_path)
    again = json.loads((tmp_path / TRUTHS / f"{case.spec.name}.json").read_text())
    assert again == json.loads((out / TRUTHS / f"{case.spec.name}.json").read_text())
    files = sorted(
        p.relative_to(out / CASES) for p in (out / CASES).rglob(f"{case.spec.name}/**/*.mcap")
    )
    assert files
    for file in files:
        assert (out / CASES / file).read_bytes() == (tmp_path / CASES / file).read_bytes()


def test_recordings_say_nothing_of_what_is_hidden(study: tuple[Path, list[Any]]) -> None:
    out, cases = study
    seen = set()
    for case in cases:
        record = truth_record(case)
        folder = out / CASES / case.spec.name
        names = {str(p.relative_to(folder)) for p in folder.rglob("*")}
        words = {case.spec.kind, *(e["name"] for e in record["effects"])}
        for path in folder.rglob("*"):
            if path.is_file() and path.suffix != ".mcap":
                text = path.read_text(encoding="utf-8")
                assert not any(word in text for word in words), path
        assert not any(word in name for word in words for name in names)
        for part in ("train", "check"):
            (bag,) = (folder / part).iterdir()
            recording = read_recording(bag, case.robot.robot)
            seen.add((part, len(recording), tuple(sorted(recording.metadata)), len(names)))
            assert recording.metadata["note"] == ""
            assert not recording.gaps
    # The same lengths and the same kinds of metadata, whatever is hidden.
    assert len(seen) == 2


def test_recording_is_what_the_machine_did(study: tuple[Path, list[Any]]) -> None:
    out, cases = study
    case = cases[0]
    (bag,) = (out / CASES / case.spec.name / "train").iterdir()
    recording = read_recording(bag, case.robot.robot)
    counts = 2 * np.pi / case.robot.robot.sensors.encoder_counts_per_rev
    assert np.abs(recording.q - case.train.track.states[:, :2]).max() < 6 * counts
    assert recording.valve_v is not None
    np.testing.assert_allclose(recording.valve_v, 10.0 * case.train.track.commands)
    assert recording.p_a is not None
    assert np.abs(recording.p_a - case.train.track.states[:, 4:6]).max() < 6e4
    assert (recording.supply is not None) == case.machine.lines_recorded


def test_diagnosis_runs_where_the_truth_is_not(study: tuple[Path, list[Any]]) -> None:
    """A stand-in that lists what it can see from where it runs, and answers with that."""
    out, cases = study
    program = (
        "import json, os, pathlib, sys;"
        "seen = sorted(str(p) for p in pathlib.Path('.').rglob('*'));"
        "o = pathlib.Path(sys.argv[sys.argv.index('--out') + 1]); o.mkdir();"
        "(o / 'result.json').write_text(json.dumps({'seen': seen, 'argv': sys.argv[1:],"
        " 'where': os.getcwd()}))"
    )
    answer = diagnose_case(cases[1].spec.name, out, (sys.executable, "-c", program))
    assert answer["exit"] == 0
    result = answer["result"]
    told = " ".join([*result["seen"], *result["argv"], result["where"]])
    assert "truth" not in told
    assert str(out) not in told
    assert answer["baselines"] == {}
    assert sum(path.endswith(".mcap") for path in result["seen"]) == 2
    assert result["argv"].count("--validate") == 1
    assert (out / ANSWERS / f"{cases[1].spec.name}.json").is_file()
    with pytest.raises(IdentError, match="no such case"):
        diagnose_case("absent", out)
    with pytest.raises(IdentError, match="folder of the study's own"):
        diagnose_case("absent", Path(sys.prefix).parent)


def test_a_diagnosis_that_looks_for_the_truth_finds_none(study: tuple[Path, list[Any]]) -> None:
    """It is told where the truth lies, and tries by every way that it has."""
    if not can_seclude():
        pytest.skip("this system has no user namespaces: nothing can be kept out of a folder")
    out, cases = study
    truth = (out / TRUTHS / f"{cases[1].spec.name}.json").resolve()
    assert truth.is_file()
    program = f"""
import json, os, pathlib, subprocess, sys
truth, over, parent = {str(truth)!r}, {str(out.resolve())!r}, os.getppid()
found = []
for path in (truth, f"/proc/self/root{{truth}}", f"/proc/{{parent}}/root{{truth}}"):
    try:
        found.append(open(path).read())
    except OSError as error:
        pass
uncover = f"umount {{over}}; cat {{truth}}"
for line in (uncover, f"nsenter -t {{parent}} -m cat {{truth}}",
             f"unshare --user --map-root-user --mount sh -c '{{uncover}}'"):
    done = subprocess.run(line, shell=True, capture_output=True, text=True)
    found += [done.stdout] if done.stdout else []
out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1])
out.mkdir()
(out / "result.json").write_text(json.dumps({{"found": found}}))
"""
    answer = diagnose_case(cases[1].spec.name, out, (sys.executable, "-c", program))
    assert (answer["exit"], answer["secluded"]) == (0, True), answer
    assert answer["result"]["found"] == []
    assert truth.is_file()


def test_what_answers_knows_nothing_of_the_study() -> None:
    """Nothing that a diagnosis imports has to do with what makes the recordings."""
    program = (
        "import sys; import hydro_ident.study.answer, hydro_ident.commands.diagnose;"
        "from hydro_ident.mismatch import baselines, diagnosis, diagnosis_file;"
        "own = ('hydro_ident.study.', 'hydro_hw_bridge');"
        "print([m for m in sys.modules if m.startswith(own)])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "['hydro_ident.study.answer']"


def test_a_label_in_the_files_would_show() -> None:
    random = np.random.default_rng(6)
    truths = [
        {
            "kind": "clean" if random.random() < 0.4 else "single",
            "outward": {"files": 6.0, "train_bytes": random.normal(), "name": random.random()},
        }
        for _ in range(120)
    ]
    fair = leak(truths)
    assert fair is not None
    assert fair["p_value"] > 0.02
    for truth in truths:
        truth["outward"]["train_bytes"] += 2.0 * (truth["kind"] == "clean")  # type: ignore[index]
    told = leak(truths)
    assert told is not None
    assert told["p_value"] < 0.01
    assert told["p_value_without_sizes"] > 0.02
    assert leak(truths[:8]) is None


def test_files_look_the_same_whatever_is_hidden(study: tuple[Path, list[Any]]) -> None:
    out, cases = study
    seen = [outward(out / CASES / case.spec.name) for case in cases]
    for name in ("files", "robot_bytes", "train_duration_s", "check_duration_s"):
        assert len({one[name] for one in seen}) == 1, name
    # But for the oil's temperature, which is on record in half of the cases.
    assert {one["train_topics"] for one in seen} <= {4.0, 5.0}


def test_diagnosis_that_fails_is_an_answer_too(study: tuple[Path, list[Any]]) -> None:
    out, cases = study
    failing = (sys.executable, "-c", "import sys; print('no good', file=sys.stderr); sys.exit(1)")
    answer = diagnose_case(cases[0].spec.name, out, failing)
    assert (answer["exit"], answer["error"], answer["result"]) == (1, "no good", None)


def test_truth_says_size_limit_and_channels(study: tuple[Path, list[Any]]) -> None:
    _, cases = study
    assert truth_record(cases[0])["effects"] == []
    for case, count in zip(cases[1:], (1, 2, 1), strict=True):
        effects = truth_record(case)["effects"]
        assert len(effects) == count
        for effect in effects:
            assert effect["size"] > 0.0
            assert effect["ratio"] == pytest.approx(effect["size"] / effect["limit"])
            assert effect["channels"]
    assert not truth_record(cases[3])["effects"][0]["known"]


def test_seed_from_a_commit() -> None:
    assert frozen_seed("abc1234") == frozen_seed("ABC1234") != frozen_seed("abc1235")
    with pytest.raises(IdentError, match="expected --frozen"):
        frozen_seed("main")


def test_a_stopped_case_goes_on_where_it_was(
    study: tuple[Path, list[Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec, robot = study[1][0].spec, study[1][0].robot
    asked: list[int] = []

    def answer(name: str, out: Path) -> dict[str, Any]:
        asked.append(sum(1 for _ in (out / CASES / name).rglob("*.mcap")))
        result = {"verdict": "matches", "findings": [], "unexplained": []}
        content = {"exit": 0, "seconds": 1.0, "result": result}
        write_json(out / ANSWERS / f"{name}.json", content)
        return content

    monkeypatch.setattr("hydro_ident.study.conceal.diagnose_case", answer)
    monkeypatch.setattr("hydro_ident.study.robots.study_robot", lambda *which: robot)
    monkeypatch.setattr("hydro_ident.study.generate.work", lambda *which: robot.excitation)
    write_json(tmp_path / "plan.json", {"cases": 4, "seed": spec.seed, "frozen": None})
    row = one_case(spec, tmp_path, False, False)
    assert (row["kind"], row["findings"]) == ("clean", 0)
    assert not (tmp_path / CASES / spec.name).exists()
    assert one_case(spec, tmp_path, False, False) == row
    assert asked == [2]
    # Stopped before the answer, and after the recordings were taken away: made again, the same.
    (tmp_path / ANSWERS / f"{spec.name}.json").unlink()
    assert one_case(spec, tmp_path, False, True) == row
    assert asked == [2, 2]
    assert (tmp_path / CASES / spec.name).is_dir()


def test_another_plan_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text('{"cases": 4, "seed": 1, "frozen": null}')
    with pytest.raises(IdentError, match="holds a study of 4 cases"):
        run(["--out", str(tmp_path), "--cases", "5", "--seed", "1"])


def test_quiet_machine_has_no_extras_left(plain: Machine) -> None:
    assert replace(plain.truth, extras=Extras()).extras == Extras()
