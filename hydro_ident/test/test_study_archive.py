"""A study taken to another machine: what is done there stays done here."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import pytest

from hydro_ident.errors import IdentError
from hydro_ident.study.archive import pack, unpack
from hydro_ident.study.command import main, run
from hydro_ident.study.conceal import ANSWERS, ORACLES, TRUTHS, write_json

PLAN = {"cases": 9, "seed": 4, "frozen": None}


def _study(out: Path) -> list[dict[str, Any]]:
    """Two cases, one without an oracle."""
    for name in ("aa", "bb"):
        for folder in (TRUTHS, ANSWERS, ORACLES)[: 3 if name == "aa" else 2]:
            write_json(out / folder / f"{name}.json", {"of": folder, "case": name})
    return [{"case": "bb", "verdict": "matches"}, {"case": "aa", "verdict": "explained"}]


def _content(out: Path) -> dict[str, Any]:
    files = sorted(path for path in out.rglob("*.json"))
    return {str(path.relative_to(out)): json.loads(path.read_text()) for path in files}


def test_a_study_comes_out_as_it_went_in(tmp_path: Path) -> None:
    here, there, file = tmp_path / "here", tmp_path / "there", tmp_path / "study.tar.xz"
    scores = _study(here)
    pack(file, here, PLAN, scores)
    assert unpack(file, there, PLAN) == scores
    assert _content(there) == _content(here)


def test_the_same_cases_give_the_same_bytes(tmp_path: Path) -> None:
    scores = _study(tmp_path)
    for name in ("one", "other"):
        pack(tmp_path / name, tmp_path, PLAN, scores)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "other").read_bytes()


def test_what_is_there_already_stays(tmp_path: Path) -> None:
    here, there, file = tmp_path / "here", tmp_path / "there", tmp_path / "study.tar.xz"
    pack(file, here, PLAN, _study(here))
    own = {"of": "this machine"}
    write_json(there / ANSWERS / "aa.json", own)
    unpack(file, there, PLAN)
    assert json.loads((there / ANSWERS / "aa.json").read_text()) == own


def test_another_study_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "study.tar.xz"
    pack(file, tmp_path, PLAN, _study(tmp_path))
    with pytest.raises(
        IdentError, match=r"expected a study of plan .*'seed': 5.* found .*'seed': 4"
    ):
        unpack(file, tmp_path, PLAN | {"seed": 5})


@pytest.mark.parametrize("content", [b"", b"no archive", b"\xfd7zXZ\x00\x00\x04 cut off"])
def test_what_is_no_archive_is_one_error(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "study.tar.xz"
    file.write_bytes(content)
    with pytest.raises(IdentError, match="expected an archive of a study, found"):
        unpack(file, tmp_path, PLAN)


def test_a_hostile_archive_writes_nothing_outside(tmp_path: Path) -> None:
    """Only names that a case's own scores ask for, in the study's three folders."""
    file, out = tmp_path / "study.tar.xz", tmp_path / "deep" / "out"
    out.mkdir(parents=True)
    scores = [{"case": "../../escaped"}]
    members = {"plan.json": PLAN, "scores.json": scores, f"{TRUTHS}/../../escaped.json": {}}
    with tarfile.open(file, "w:xz") as archive:
        for name, content in members.items():
            data = json.dumps(content).encode()
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    with pytest.raises(IdentError, match="expected a case's name"):
        unpack(file, out, PLAN)
    assert [path.name for path in tmp_path.rglob("*.json")] == []


def test_the_command_counts_an_archives_cases_as_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "study.tar.xz", tmp_path / "out"
    words = [
        "--out",
        str(out),
        "--cases",
        "2",
        "--seed",
        "4",
        "--done-only",
        "--archive",
        str(file),
    ]
    pack(file, tmp_path, {"cases": 2, "seed": 4, "frozen": None}, [])
    assert run(words) == 0
    assert "0 done" in capsys.readouterr().out
    assert unpack(file, tmp_path, {"cases": 2, "seed": 4, "frozen": None}) == []


def test_the_command_says_what_is_wrong_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "study.tar.xz"
    file.write_text("nothing")
    words = ["study", "--out", str(tmp_path / "out"), "--cases", "2", "--archive", str(file)]
    monkeypatch.setattr("sys.argv", words)
    assert main() == 2
    said = capsys.readouterr().err
    assert "expected an archive of a study" in said
    assert "Traceback" not in said
