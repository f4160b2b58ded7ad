"""Bags given on a command line: each once, under a name of its own."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hydro_ident.bag.streaming import COLUMNS, OVERLAP_S, PIECE_S, Piece
from hydro_ident.errors import IdentError
from hydro_ident.identify.origin import bag_sha256, provenance
from hydro_ident.identify.survey import survey_source
from hydro_ident.recordings.sources import Source, bag_sources, short_kept
from hydro_model.robot import Robot


@pytest.fixture
def runs(write_bag: Callable[..., Path]) -> list[Path]:
    """Bags of one name, of different positions, in folders of their own."""
    paths = []
    for k, name in enumerate(("monday/am/run", "monday/pm/run", "tuesday/am/run", "other")):
        wave = 0.1 * k + np.sin(np.linspace(0.0, 6.0, 300))
        fields = {"position": np.stack([wave, -wave], axis=1)}
        paths.append(write_bag({"/joint_states": (("lift", "tilt"), fields)}, name=name))
    return paths


def test_runs_of_one_name_are_told_apart_by_their_folders(runs: list[Path], robot: Robot) -> None:
    training, validation = bag_sources(runs[:2], runs[2:], robot)
    names = [source.name for source in (*training, *validation)]
    assert names == ["monday_am_run", "pm_run", "tuesday_am_run", "other"]
    for path, source in zip(runs, (*training, *validation), strict=True):
        assert source.path == path
        survey = survey_source(source, robot)
        assert survey.name == source.name
        (piece,) = source.pieces()
        assert piece.recording.path.name == source.name


def test_names_that_differ_stay(runs: list[Path], robot: Robot) -> None:
    training, validation = bag_sources(runs[:1], runs[3:], robot)
    assert [s.name for s in (*training, *validation)] == ["run", "other"]


def test_a_bag_is_given_once(
    runs: list[Path], robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is learnt from cannot verify."""
    monkeypatch.chdir(runs[0].parent)
    with pytest.raises(IdentError, match="expected each bag once, found 'run' twice"):
        bag_sources([runs[0]], ["run"], robot)


class _Counted:
    """A source that counts how often it is read."""

    def __init__(self, source: Source) -> None:
        self.source, self.read = source, 0
        self.name = source.name

    def pieces(self, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S) -> Iterator[Piece]:
        self.read += 1
        return self.source.pieces(piece_s, overlap_s)


def test_a_short_recording_is_read_once_and_a_long_one_in_every_pass(
    runs: list[Path], robot: Robot
) -> None:
    """Pieces that are shorter than what was kept are cut from the bag; budgets hold for all."""
    (source,), _ = bag_sources(runs[:1], (), robot)
    counted = _Counted(source)
    (kept,) = short_kept([counted])
    (first,), (again,) = kept.pieces(), kept.pieces(2.0 * PIECE_S)
    assert counted.read == 1
    assert again is first
    span_s = 1e-9 * float(np.ptp(first.recording.stamp_ns))
    short = list(kept.pieces(0.25 * span_s, 0.1 * span_s))
    assert len(short) > 1
    assert counted.read == 2

    pieces = _Counted(source)
    (streamed,) = short_kept([pieces])
    for _ in range(2):
        assert len(list(streamed.pieces(0.25 * span_s, 0.1 * span_s))) == len(short)
    assert pieces.read == 2

    pair = [_Counted(source), _Counted(source)]
    size = sum(v.nbytes for v in _columns(first))
    for one in short_kept(pair, most_bytes=int(1.5 * size)):
        for _ in range(3):
            assert len(list(one.pieces())) == 1
    assert [one.read for one in pair] == [1, 3]


def _columns(piece: Piece) -> list[NDArray[Any]]:
    return [v for n in COLUMNS if (v := getattr(piece.recording, n)) is not None]


@pytest.fixture
def split(runs: list[Path], write_bag: Callable[..., Path], tmp_path: Path) -> Path:
    """A bag of two files, of two of the runs."""
    folder = tmp_path / "split"
    folder.mkdir()
    for k, run in enumerate(runs[:2]):
        [file] = run.glob("*.mcap")
        shutil.copy(file, folder / f"split_{k}.mcap")
    return folder


@pytest.mark.parametrize("how", ["file", "copy", "part"])
def test_a_bag_that_is_learnt_from_cannot_verify_by_another_path(
    runs: list[Path], split: Path, tmp_path: Path, how: str
) -> None:
    """Its bare file, a copy of it, or a bag of which it is a part."""
    [file] = runs[0].glob("*.mcap")
    copy = shutil.copytree(runs[0], tmp_path / "copy")
    other = {"file": file, "copy": copy, "part": split}[how]
    for learnt, scored in ((runs[0], other), (other, runs[0])):
        with pytest.raises(IdentError, match="of which nothing is learnt, found files of 'b'"):
            provenance("identify", "xs031", {"a": learnt}, {"b": scored})
    kept = provenance("identify", "xs031", {"a": runs[0]}, {"b": runs[2]})
    assert kept.bags["a"] == bag_sha256(copy)
    assert kept.validation["b"] != kept.bags["a"]


def test_files_that_were_only_begun_make_two_recordings_no_copies(
    runs: list[Path], tmp_path: Path
) -> None:
    """A recorder that has just gone to its next file leaves the same bytes in every bag."""
    bags = {}
    for name, run in zip("ab", runs, strict=False):
        bags[name] = shutil.copytree(run, tmp_path / name)
        (bags[name] / "next.mcap").write_bytes(b"header and definitions" * 100)
    kept = provenance("identify", "xs031", bags, {})
    assert kept.bags["a"] != kept.bags["b"]


@pytest.mark.parametrize("how", ["file", "copy", "part"])
@pytest.mark.parametrize("to_verify", [False, True])
def test_a_recording_counts_once_however_it_is_given(
    runs: list[Path], split: Path, tmp_path: Path, how: str, to_verify: bool
) -> None:
    """Fitted twice, its intervals had been those of twice the data."""
    [file] = runs[0].glob("*.mcap")
    copy = shutil.copytree(runs[0], tmp_path / "copy")
    both = {"a": runs[0], "b": {"file": file, "copy": copy, "part": split}[how]}
    bags, validation = ({"other": runs[3]}, both) if to_verify else (both, {})
    said = "expected each recording once, found files of 'b' in 'a', too"
    with pytest.raises(IdentError, match=said):
        provenance("identify", "xs031", bags, validation)
