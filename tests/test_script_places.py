"""Scripts find what lies beside them, and refuse or go on with what they find in a folder."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

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


@pytest.mark.ros
@pytest.mark.parametrize("duration", [".5", "00.08"])
def test_a_run_of_less_than_a_second_ends(duration: str, tmp_path: Path) -> None:
    arguments = [*ARGUMENTS["rig_run"], "--duration", duration]
    done = run(ROOT / "scripts/rig_run.sh", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"run n: {duration} s of machine time" in done.stderr
    assert len(list((tmp_path / "o/bags").glob("*_n/*.mcap"))) == 1
