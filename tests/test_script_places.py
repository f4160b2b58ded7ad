"""Scripts find what lies beside them, and refuse or go on with what they find in a folder."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_hw_bridge.rig.command import _driven_cycles, _parser
from hydro_hw_bridge.rig.truth_log import TruthLog
from hydro_model.motion.paths import shipped_paths
from hydro_model.robot_files import shipped_robots

ROOT = Path(__file__).resolve().parents[1]
#: What each is given to get as far as the environment.
ARGUMENTS = {
    "bringup": ["--sim"],
    "demo": ["--out", "demo"],
    "rig_run": ["--name", "n", "--path", "xs031/parallelogram", "--out", "o"],
    "record": ["name"],
    "replay": ["."],
    "identify": ["bag"],
    "faults": [],
    "new_robot": ["crane.urdf"],
    "test": [],
}
#: It begins further from joints at 0.6 and -1.5 rad than a controller goes there by itself.
FAR = """\
joints: [lift, tilt]
start: [0.0, -0.9]
segments: [{kind: move, to: [0.05, -0.85], duration_s: 1.5}]
"""
#: Rig, bridge, recorder, controller and lifecycle client in one, which do nothing.
STUB = """#!/usr/bin/env bash
case $* in
  "activate /can_bridge "*) touch "$0.driven" ;;
  configure*|activate*) ;;
  *--force) printf '%s\n' o/bus/own.dbc o/bus/own.mapping.yaml ;;
  *clock:=*) printf '%s\n' "$@" >"$0.bridge"; echo "$bridge"; exec sleep 240 ;;
  *path:=*) printf '%s\n' "$@" >"$0.controller"; echo "receiving /tip_reference"
     echo "${controlled:-}"; exec sleep 240 ;;
  *--truth-out*) echo "ready, told $*"; until [[ -e $0.driven ]]; do sleep 0.05; done ;;
  *) echo "receiving /joint_states, receiving /chamber_pressures, receiving /tip_reference"
     exec sleep 240 ;;
esac
"""


def run(
    script: Path, *arguments: str, cwd: Path, **environment: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", str(script), *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
        cwd=cwd,
        env={**os.environ, **environment},
    )


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A folder with the scripts, by a path with a space."""
    folder = tmp_path / "lab tools"
    shutil.copytree(ROOT / "scripts", folder / "scripts")
    shutil.copytree(ROOT / ".ci", folder / ".ci")
    return folder


@pytest.mark.parametrize("script", ARGUMENTS)
def test_a_search_path_of_cd_leads_no_script_astray(script: str, elsewhere: Path) -> None:
    (elsewhere / "scripts/env.sh").write_text("exit 7\n", encoding="utf-8")
    # Found by the search path, `cd` prints where it went.
    relative, cdpath = Path("scripts") / f"{script}.sh", f"{elsewhere}:{ROOT}"
    done = run(relative, *ARGUMENTS[script], cwd=elsewhere, CDPATH=cdpath)
    assert (done.returncode, done.stdout, done.stderr) == (7, "", "")


def test_nor_set_up(elsewhere: Path) -> None:
    done = run(Path("scripts/setup.sh"), cwd=ROOT, CDPATH=f"{ROOT}:{elsewhere}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_nor_what_continuous_integration_runs(elsewhere: Path, tmp_path: Path) -> None:
    stub = elsewhere / "scripts/test.sh"
    stub.write_text("#!/usr/bin/env bash\npwd\n", encoding="utf-8")
    (tmp_path / "other/.ci").mkdir(parents=True)
    cdpath = str(tmp_path / "other")
    done = run(Path(".ci/run"), cwd=elsewhere, CDPATH=cdpath, CI="")
    assert (done.returncode, done.stdout) == (0, f"{elsewhere}\n")


@pytest.mark.parametrize("script", ["setup", *ARGUMENTS])
def test_a_path_with_a_space_is_refused_by_every_script(script: str, elsewhere: Path) -> None:
    path = elsewhere / "scripts" / f"{script}.sh"
    done = run(path, *ARGUMENTS.get(script, []), cwd=elsewhere)
    said = f"setup: expected a path without spaces, found '{elsewhere}': move it\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said)


@pytest.mark.parametrize("begun", ["experiment", "bags", "discovered", "tracking.json"])
def test_a_demo_is_not_mixed_with_an_earlier_one(begun: str, tmp_path: Path) -> None:
    (tmp_path / "out" / begun).mkdir(parents=True)
    done = run(ROOT / "scripts/demo.sh", "--out", "out", cwd=tmp_path)
    assert done.returncode == 2
    [said] = done.stderr.splitlines()
    assert said.startswith("demo: out holds the ")
    assert said.endswith("choose another --out")
    assert [file.name for file in (tmp_path / "out").iterdir()] == [begun]


@pytest.mark.parametrize("duration", ["1e1", "-1", ".", "1,5", "5 s"])
def test_a_run_of_no_duration_is_refused(duration: str, tmp_path: Path) -> None:
    arguments = [*ARGUMENTS["rig_run"], "--duration", duration]
    done = run(ROOT / "scripts/rig_run.sh", *arguments, cwd=tmp_path)
    said = f"rig_run: --duration: expected seconds such as 12.5, found '{duration}'\n"
    assert (done.returncode, done.stderr) == (2, said)
    assert not list(tmp_path.iterdir())


@pytest.mark.thorough
@pytest.mark.ros
def test_a_run_of_less_than_a_second_ends(tmp_path: Path) -> None:
    arguments = [*ARGUMENTS["rig_run"], "--duration", "00.08"]
    done = run(ROOT / "scripts/rig_run.sh", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "run n: 00.08 s of machine time" in done.stderr
    assert len(list((tmp_path / "o/bags").glob("*_n/*.mcap"))) == 1


def run_around(
    folder: Path, duration: str, *options: str, **said: str
) -> subprocess.CompletedProcess[str]:
    """`rig_run` around processes that do nothing; what its bridge and controller say."""
    shutil.copytree(ROOT / "scripts", folder / "scripts")
    stub = folder / "stub"
    stub.write_text(STUB, encoding="utf-8")
    stub.chmod(0o755)
    exe = "hydro_exe() { printf '%s' \"$stub\"; }\n"
    (folder / "scripts/env.sh").write_text(exe, encoding="utf-8")
    arguments = [*ARGUMENTS["rig_run"], "--duration", duration, *options]
    said = {"bridge": "reading"} | said
    return run(folder / "scripts/rig_run.sh", *arguments, cwd=folder, stub=str(stub), **said)


def test_a_run_whose_gate_tripped_fails_with_the_reason(tmp_path: Path) -> None:
    why = "tripped: no command for 12 ms"
    done = run_around(tmp_path, ".5", bridge=f"[ERROR] [1.0] [can_bridge]: {why}")
    assert done.returncode == 1
    log = tmp_path / "o/logs/n.bridge.log"
    assert done.stderr.splitlines()[0] == f"run n is cut short, the gate {why} (log {log})"
    assert "s of machine time" not in done.stderr


@pytest.mark.parametrize("enabled", [True, False])
def test_in_real_time_it_fails_where_the_rig_saw_it(enabled: bool, tmp_path: Path) -> None:
    """Behind a rig that has ended every gate trips."""
    (tmp_path / "o/truth").mkdir(parents=True)
    with TruthLog(tmp_path / "o/truth/n.npz", ("time_s", "enabled"), {}) as truth:
        for row in ((0.0, 0.0), (0.002, 1.0), (0.004, float(enabled))):
            truth.append(np.array(row))
    why = "tripped: no whole cycle for 12 ms"
    said = f"[ERROR] [1.0] [can_bridge]: {why}"
    done = run_around(tmp_path, ".5", "--real-time", bridge=said)
    assert done.returncode == (0 if enabled else 1), done.stderr
    assert (f"run n is cut short, the gate {why}" in done.stderr) != enabled


@pytest.mark.parametrize(
    "why",
    [
        "path refused, holding: it begins 0.4 m from the tip",
        "holding: the motion was dropped, as joint 'lift' stands",
        "0 V: a sample is not finite",
        "stamps went back by 3.000 s, expected them to grow",
    ],
)
def test_a_run_whose_controller_drives_no_path_fails_with_the_reason(
    why: str, tmp_path: Path
) -> None:
    done = run_around(tmp_path, ".5", controlled=f"[WARN] [1.0] [controller]: {why}")
    assert done.returncode == 1
    said = f"run n did not drive its path, the controller says {why}"
    log = tmp_path / "o/logs/n.controller.log"
    assert done.stderr.splitlines()[0] == f"{said} (log {log})"
    assert "s of machine time" not in done.stderr


@pytest.mark.thorough
@pytest.mark.ros
def test_a_path_that_begins_far_from_the_joints_is_no_run(tmp_path: Path) -> None:
    path = tmp_path / "far.yaml"
    path.write_text(FAR, encoding="utf-8")
    arguments = ["--name", "n", "--out", "o", "--path", str(path), "--joints", "0.6 -1.5"]
    done = run(ROOT / "scripts/rig_run.sh", *arguments, cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    [said] = [line for line in done.stderr.splitlines() if line.startswith("run n ")]
    assert said.startswith("run n did not drive its path, the controller says path refused, ")
    # What there is of it can be looked at all the same.
    assert len(list((tmp_path / "o/bags").glob("*_n/*.mcap"))) == 1


def test_nor_does_one_written_without_its_0_fail(tmp_path: Path) -> None:
    """How the script takes it; the rig takes it as it is."""
    done = run_around(tmp_path, ".5")
    assert done.returncode == 0, done.stderr
    # Arithmetic that fails is said by the shell, which goes on with the script.
    assert re.fullmatch(r"run n: \.5 s of machine time in \d+ s\n", done.stderr)
    words = (tmp_path / "o/logs/n.rig.log").read_text(encoding="utf-8").split()
    duration = words[words.index("--duration") + 1]
    assert duration == ".5"
    assert _driven_cycles(_parser().parse_args(["--duration", duration]).duration, 0.002) == 250


def test_files_are_told_to_the_nodes_by_their_whole_names(tmp_path: Path) -> None:
    """A parameter's value is read as YAML: what follows ` #` would be a remark."""
    lab = tmp_path / "lab #2: it's"
    lab.mkdir()
    shutil.copy(ROOT / "hydro_msgs_docs/can/xs031.mapping.yaml", lab)
    shutil.copy(shipped_paths()["xs031/parallelogram"], lab / "path.yaml")
    mapping, path = lab / "xs031.mapping.yaml", lab / "path.yaml"
    done = run_around(tmp_path, ".5", "--mapping", str(mapping), "--path", str(path))
    assert done.returncode == 0, done.stderr

    assert told(tmp_path, "bridge")["mapping"] == str(mapping)
    assert told(tmp_path, "controller")["path"] == str(path)


def told(folder: Path, node: str) -> dict[str, object]:
    """The parameters that a node was given, as it reads them."""
    words = (folder / f"stub.{node}").read_text(encoding="utf-8").splitlines()
    pairs = (word.split(":=", 1) for word in words if ":=" in word)
    return {name: yaml.safe_load(value) for name, value in pairs}


def test_the_bus_is_the_robots_own_where_another_ones_lies_beside(tmp_path: Path) -> None:
    shipped = shipped_robots()["xs031"]
    shutil.copy(shipped.with_name("xs031.urdf"), tmp_path)
    own = shipped.read_text(encoding="utf-8").replace("robot: xs031", "robot: own")
    (tmp_path / "own.hydraulics.yaml").write_text(own, encoding="utf-8")
    bus = tmp_path / "o/bus"
    bus.mkdir(parents=True)
    for name in ("another", "own"):
        (bus / f"{name}.mapping.yaml").touch()
    done = run_around(tmp_path, ".5", "--rig", "own.hydraulics.yaml")
    assert done.returncode == 0, done.stderr
    assert told(tmp_path, "bridge")["mapping"] == "o/bus/own.mapping.yaml"
