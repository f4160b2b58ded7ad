"""Bare names with tab completion: each is this product's, whatever else is called so."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("hydro_hw_bridge", "hydro_control", "hydro_ident", "hydro_msgs_docs")
#: Names that other people's programs have, too: python-can's, and ImageMagick's.
TAKEN = ("can_bridge", "convert")


def sourced(script: str, first_on_path: Path) -> str:
    """What a shell prints that has sourced completion.sh and has other programs first in PATH."""
    lines = f"source {ROOT}/scripts/env.sh; PATH={first_on_path}:$PATH\n"
    lines += f"source {ROOT}/scripts/completion.sh\n{script}\n"
    done = subprocess.run(
        ["bash", "-c", lines], capture_output=True, text=True, check=False, timeout=240
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def others(tmp_path: Path) -> Path:
    """A folder of programs that are called as ours are."""
    for name in (*TAKEN, "identify"):
        (tmp_path / name).write_text("#!/bin/sh\necho somebody else\n", encoding="utf-8")
        (tmp_path / name).chmod(0o755)
    return tmp_path


def test_every_name_is_this_products(others: Path) -> None:
    folders = [ROOT / "ros2_ws/install" / p / "lib" / p for p in PACKAGES]
    ours = {path.name: path for folder in folders for path in folder.iterdir()}
    assert set(TAKEN) < set(ours)
    told = sourced(f"for name in {' '.join(ours)}; do declare -f $name; done", others)
    runs = dict(re.findall(r'^(\w+) \(\) *\n\{ *\n +(\S+) "\$@"', told, re.M))
    assert {name: Path(path) for name, path in runs.items()} == ours


def test_they_run_and_leave_the_others_alone(others: Path) -> None:
    for name in TAKEN:
        told = sourced(f"{name} --help; echo; command {name}", others)
        assert re.search(rf"usage: .*{name}", told), told
        assert told.endswith("somebody else\n")


@pytest.mark.skipif(
    importlib.util.find_spec("argcomplete") is None, reason="argcomplete is optional"
)
def test_a_name_that_is_taken_completes_with_our_options(others: Path) -> None:
    for name, begun, option in (
        ("convert", "--sug", "--suggest"),
        ("identify", "--val", "--validate"),
    ):
        line = f"{name} {begun}"
        told = sourced(
            f"COMP_LINE='{line}' COMP_POINT={len(line)} COMP_TYPE=9 COMP_WORDBREAKS=' '\n"
            f'complete -p {name}; _python_argcomplete {name}; echo "${{COMPREPLY[@]}}"',
            others,
        )
        assert f"_python_argcomplete {name}" in told
        assert option in told


@pytest.mark.skipif(
    importlib.util.find_spec("argcomplete") is None, reason="argcomplete is optional"
)
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("identify --robot ", {"emps", "patu655", "xs031", "mine.hydraulics.yaml", "xs/"}),
        ("sim_rig --robot x", {"xs031", "xs/"}),
        ("live_layouts --robot xs/", {"xs/other.hydraulics.yaml"}),
        ("check_robot ", {"emps", "patu655", "xs031", "mine.hydraulics.yaml", "xs/"}),
    ],
)
def test_robots_are_offered_by_name_beside_files(
    line: str, offered: set[str], tmp_path: Path
) -> None:
    (tmp_path / "xs").mkdir()
    for file in ("mine", "xs/other"):
        (tmp_path / f"{file}.hydraulics.yaml").touch()
    name = line.split()[0]
    told = sourced(
        f"cd {tmp_path}\n"
        f"COMP_LINE='{line}' COMP_POINT={len(line)} COMP_TYPE=9 COMP_WORDBREAKS=' '\n"
        f'_python_argcomplete {name}; printf "offered %s\\n" "${{COMPREPLY[@]}}"',
        tmp_path,
    )
    found = {word.strip() for word in re.findall(r"^offered (.*)$", told, re.M)}
    options = {word for word in found if word.startswith("-")}
    assert found - options == offered


def test_it_wants_to_be_sourced() -> None:
    done = subprocess.run(
        ["bash", str(ROOT / "scripts/completion.sh")],
        capture_output=True,
        text=True,
        check=False,
        env=dict(os.environ),
    )
    assert done.returncode == 2
    assert "source it" in done.stderr
