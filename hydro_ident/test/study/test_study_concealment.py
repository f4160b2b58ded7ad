"""Cases of the concealed-physics study: made, hidden, answered; nothing tells what is hidden."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import read_recording
from hydro_ident.errors import IdentError
from hydro_ident.study.command import one_case
from hydro_ident.study.conceal import ANSWERS, CASES, TRUTHS, diagnose_case, write_case, write_json
from hydro_ident.study.experiments import Motion
from hydro_ident.study.generate import CaseSpec, make_case, truth_record
from hydro_ident.study.leaks import leak, outward
from hydro_ident.study.robots import StudyRobot
from hydro_ident.study.seclusion import can_seclude
from hydro_model.robot_files import load_robot, shipped_robots

Draw = Callable[[CaseSpec], Any]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory, motion: Motion) -> tuple[Path, Draw]:
    """A study of one crane, and what draws its cases: short motions in place of designed ones."""
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

    def draw(spec: CaseSpec) -> Any:
        with pytest.MonkeyPatch.context() as patch:
            # Work cycles of a minute would take too long; they are another motion, no more.
            patch.setattr("hydro_ident.study.generate.work", lambda robot, seed: (motion, half))
            return make_case(spec, robots)

    return out, draw


@pytest.fixture(scope="module")
def study(drawn: tuple[Path, Draw]) -> tuple[Path, list[Any]]:
    """Four cases, written."""
    out, draw = drawn
    kinds = ("clean", "single", "double", "outside")
    cases = [draw(CaseSpec(5, i, kind)) for i, kind in enumerate(kinds)]  # type: ignore[arg-type]
    for case in cases:
        write_case(case, out)
    return out, cases


def test_case_follows_from_its_seed(
    study: tuple[Path, list[Any]], drawn: tuple[Path, Draw], tmp_path: Path
) -> None:
    out, cases = study
    case = drawn[1](cases[1].spec)
    write_case(case, tmp_path)
    again = json.loads((tmp_path / TRUTHS / f"{case.spec.name}.json").read_text())
    assert again == json.loads((out / TRUTHS / f"{case.spec.name}.json").read_text())
    files = sorted(
        p.relative_to(out / CASES) for p in (out / CASES / case.spec.name).rglob("*.mcap")
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
        "from hydro_ident.mismatch.answer import diagnosis, diagnosis_file;"
        "from hydro_ident.mismatch.naming import baselines;"
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
