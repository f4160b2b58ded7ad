"""Bags in pieces: the same cycles, the same results, in flat memory, here or on a cluster."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag import digest
from hydro_ident.bag.digest import Digest
from hydro_ident.bag.recording import Recording, read_recording
from hydro_ident.bag.streaming import Piece, cut_recording, stream_recordings
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.identify import main
from hydro_ident.errors import BagError, IdentError
from hydro_ident.identify.identification import Identification, Settings, identify
from hydro_ident.identify.survey import survey_source
from hydro_ident.recordings.sources import BagSource
from hydro_ident.recordings.workers import DaskWorkers
from hydro_ident.study.long_bag import write_repeated
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.long

#: No scores and no roll-outs: what is tested here comes before them.
NOTHING_HELD_OUT = Settings(hold_out_every=0)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return synthetic_recording(load_robot("xs031"), 40.0, seed=1)


@pytest.fixture(scope="module")
def bag(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "run"
    write_repeated(path, recording, 1)
    return path


def _relative(one: Identification, two: Identification) -> float:
    worst = 0.0
    for a, b in zip(one.parameters, two.parameters, strict=True):
        assert a.name == b.name
        # Frictions and delay are 0 here, what is found of them chance: the delay's scale is the
        # sampling interval, a friction's its deviation.
        least = 0.002 if a.name == "command_delay" else b.std
        worst = max(worst, abs(a.value - b.value) / max(abs(b.value), least, 1e-30))
        worst = max(worst, abs(a.std - b.std) / max(b.std, least, 1e-30))
    return worst


def test_pieces_hold_every_cycle_once_in_order(bag: Path, robot: Robot) -> None:
    whole = read_recording(bag, robot)
    pieces = list(stream_recordings(bag, robot, piece_s=7.0, overlap_s=1.0))
    assert len(pieces) == 6
    cores = [cut_recording(p.recording, p.core) for p in pieces]
    for name in ("stamp_ns", "q", "p_a", "valve_v", "q_ref"):
        joined = np.concatenate([getattr(core, name) for core in cores])
        assert np.array_equal(joined, getattr(whole, name)), name
    for piece in pieces[1:]:
        assert piece.core.start == 500
        assert piece.start_ns == whole.stamp_ns[0]


@pytest.mark.parametrize("split_ns", [200_000_000, 10**12])
@pytest.mark.parametrize("overlap_s", [0.1, 1.0])
def test_a_pause_of_many_pieces_is_none(
    write_bag, run_columns, robot: Robot, overlap_s: float, split_ns: int
) -> None:
    """Of two minutes, during which the bridge was off; read file by file, or at once."""
    stamps = 10**18 + 2_000_000 * np.arange(1500)
    stamps[700:] += 120_000_000_000
    path = write_bag(run_columns(1500), stamps=stamps, split_ns=split_ns)
    whole = read_recording(path, robot)
    assert len(whole) == 1500
    pieces = list(stream_recordings(path, robot, piece_s=0.5, overlap_s=overlap_s))
    cores = [cut_recording(p.recording, p.core) for p in pieces]
    assert all(len(core) for core in cores)
    digest = Digest()
    for piece in pieces:
        digest.add(piece)
    assert len(whole.gaps) == 1
    assert digest.recording().gaps == whole.gaps
    for name in ("stamp_ns", "q", "latched"):
        joined = np.concatenate([getattr(core, name) for core in cores])
        assert np.array_equal(joined, getattr(whole, name)), name


@pytest.mark.needs("clarabel")
def test_a_bag_in_pieces_identifies_as_in_memory(bag: Path, robot: Robot) -> None:
    whole = identify(robot, [read_recording(bag, robot)])
    cut = identify(robot, [_Pieces(bag, robot, 9.0)])
    assert whole.verdict == "identified"
    assert _relative(cut, whole) < 1e-9
    assert json.dumps([p.name for p in cut.parameters]) == json.dumps(
        [p.name for p in whole.parameters]
    )
    for a, b in zip(cut.channels, whole.channels, strict=True):
        for key, value in a.summary().items():
            if isinstance(value, float):
                assert value == pytest.approx(b.summary()[key], rel=1e-9), (a.name, key)


class _Pieces:
    """A bag in pieces of a length of its own."""

    def __init__(self, path: Path, robot: Robot, piece_s: float) -> None:
        self.source, self.piece_s = BagSource(path, robot), piece_s

    @property
    def name(self) -> str:
        return self.source.name

    def pieces(self, piece_s: float = 0.0, overlap_s: float = 2.0) -> Iterator[Piece]:
        del piece_s
        return self.source.pieces(self.piece_s, overlap_s)


@pytest.mark.needs("clarabel")
def test_a_gap_across_a_cut_spoils_nothing(
    recording: Recording, robot: Robot, tmp_path: Path
) -> None:
    keep = np.ones(len(recording), dtype=bool)
    keep[4400:4700] = False  # the piece's end at 9 s lies in it
    names = ("stamp_ns", "q", "p_a", "p_b", "supply", "tank", "valve_v", "q_ref", "latched")
    holed = replace(recording, **{n: getattr(recording, n)[keep] for n in names})
    pieces = _InMemory(holed, 9.0)
    assert _relative(identify(robot, [pieces]), identify(robot, [holed])) < 1e-9


class _InMemory(_Pieces):
    """A recording in memory, cut into pieces."""

    def __init__(self, recording: Recording, piece_s: float) -> None:
        self.recording, self.piece_s = recording, piece_s

    @property
    def name(self) -> str:
        return self.recording.path.name

    def pieces(self, piece_s: float = 0.0, overlap_s: float = 2.0) -> Iterator[Piece]:
        stamps, start = self.recording.stamp_ns, int(self.recording.stamp_ns[0])
        edges = np.arange(0.0, self.recording.duration_s, self.piece_s)
        for begin_s in edges:
            end_s = begin_s + self.piece_s if begin_s < edges[-1] else np.inf
            times = (stamps - start) * 1e-9
            a, b = np.searchsorted(times, [begin_s - 1e-4, end_s - 1e-4])
            low, high = np.searchsorted(times, [begin_s - overlap_s, end_s + overlap_s])
            part = cut_recording(self.recording, slice(int(low), int(high)))
            yield Piece(part, slice(int(a - low), int(b - low)), start)


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
def test_memory_does_not_grow_with_the_bag(
    recording: Recording, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same motion in pieces of twenty seconds, beyond what the digest keeps whole."""
    # Two of the pieces are more than that already: they are thinned.
    monkeypatch.setattr(digest, "LARGEST", 16_384)
    half = cut_recording(recording, slice(0, len(recording) // 2))

    class Repeated(_InMemory):
        def __init__(self, repeats: int) -> None:
            super().__init__(half, 20.0)
            self.repeats = repeats

        def pieces(self, piece_s: float = 0.0, overlap_s: float = 2.0) -> Iterator[Piece]:
            period = len(self.recording) * 2_000_000
            start = int(self.recording.stamp_ns[0])
            for k in range(self.repeats):
                moved = replace(self.recording, stamp_ns=self.recording.stamp_ns + k * period)
                for piece in _InMemory(moved, 20.0).pieces(0.0, overlap_s):
                    yield replace(piece, start_ns=start)

    peaks = []
    for repeats in (2, 4):
        tracemalloc.start()
        identify(robot, [Repeated(repeats)], settings=NOTHING_HELD_OUT)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.05 * peaks[0]


def test_a_long_recording_is_thinned_for_the_verdict(recording: Recording) -> None:
    digest = Digest()
    for k in range(5):
        moved = replace(recording, stamp_ns=recording.stamp_ns + k * len(recording) * 2_000_000)
        whole = Piece.whole(moved)
        digest.add(replace(whole, start_ns=int(recording.stamp_ns[0])))
    thin = digest.recording()
    assert digest.cycles == 5 * len(recording)
    assert 32_768 < len(thin) <= 65_536
    assert np.all(np.diff(thin.stamp_ns) == 4_000_000)
    assert digest.duration_s == pytest.approx(5 * len(recording) * 0.002 - 0.002)


def test_the_survey_finds_noise_range_and_references(recording: Recording, robot: Robot) -> None:
    survey = survey_source(_InMemory(recording, 9.0), robot)
    assert survey.referenced_s == pytest.approx(survey.usable_s)
    assert survey.signals.low == pytest.approx(recording.q.min(axis=0))
    assert survey.signals.pose == pytest.approx(recording.q.mean(axis=0))
    assert survey.wet
    assert not survey.dry


def test_an_empty_bag_is_refused(tmp_path: Path, robot: Robot) -> None:
    with BagWriter(tmp_path / "empty"):
        pass
    with pytest.raises(BagError, match="no message in this bag"):
        list(stream_recordings(tmp_path / "empty", robot))


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
def test_a_cluster_gives_the_same_numbers(robot: Robot, tmp_path: Path) -> None:
    """Each worker takes a recording as a whole, however long it is."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    for name, seed in (("one", 1), ("other", 2)):
        write_repeated(tmp_path / name, synthetic_recording(robot, 12.0, seed=seed), 1)
    sources = [BagSource(tmp_path / name, robot) for name in ("one", "other")]
    here = identify(robot, sources, settings=NOTHING_HELD_OUT)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        workers = DaskWorkers(cluster.scheduler_address)
        there = identify(robot, sources, settings=NOTHING_HELD_OUT, workers=workers)
        workers.close()
    assert _relative(there, here) < 1e-9


@pytest.mark.needs("clarabel", "plotly")
def test_no_scheduler_is_one_line_and_exit_2(
    bag: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    out = tmp_path / "out"
    arguments = ["identify", str(bag), "--robot", "xs031", "--out", str(out)]
    monkeypatch.setattr("sys.argv", [*arguments, "--scheduler", "tcp://127.0.0.1:1"])
    assert main() == 2
    error = capsys.readouterr().err
    assert "pip install distributed" in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_instruments_without_references_are_refused(recording: Recording, robot: Robot) -> None:
    with pytest.raises(IdentError, match="needs the joint references"):
        identify(robot, [replace(recording, q_ref=None)], settings=Settings(estimator="iv"))
