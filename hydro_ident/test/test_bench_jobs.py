"""Jobs of the benchmark: what is done is what their names say."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from hydro_hw_bridge.rig.core import RigCore
from hydro_ident.bench import bag_jobs, limits
from hydro_ident.study.closed_loop import Run, run_closed_loop


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bag_jobs.write_small(tmp_path_factory.mktemp("bag"))


def test_the_floor_of_reading_a_bag_touches_every_byte_of_every_chunk(
    bag: Path, tmp_path: Path
) -> None:
    (file,) = bag.glob("*.mcap")
    size, total = bag_jobs.unpacked(file)
    bag_jobs._all_unpacked(file)
    with open(file, "rb") as stream:
        reader = make_reader(stream)
        messages = sum(len(m.data) for _, _, m in reader.iter_messages())
        summary = reader.get_summary()
    assert summary is not None
    assert size == sum(one.uncompressed_size for one in summary.chunk_indexes) > messages
    one = min(summary.chunk_indexes, key=lambda c: c.chunk_start_offset)
    cut = tmp_path / "cut.mcap"
    # The first chunk alone, between the magic words.
    end = one.chunk_start_offset + one.chunk_length
    content = file.read_bytes()
    cut.write_bytes(content[:end] + content[-bag_jobs.MAGIC_SIZE :])
    alone, part = bag_jobs.unpacked(cut)
    assert alone == one.uncompressed_size
    assert 0 < part != total


def test_the_sum_is_that_of_the_bytes(bag: Path) -> None:
    import zstandard
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    (file,) = bag.glob("*.mcap")
    total, unpacker = 0, zstandard.ZstdDecompressor()
    with open(file, "rb") as stream:
        for record in StreamReader(ReadDataStream(stream), emit_chunks=True).records:
            if isinstance(record, Chunk):
                data = np.frombuffer(unpacker.decompress(record.data), np.uint8)
                whole = len(data) // 8 * 8
                words = data[:whole].reshape(-1, 8).astype(np.uint64) << np.arange(
                    0, 64, 8, dtype=np.uint64
                )
                total += int(words.sum()) + int(data[whole:].sum())
    assert bag_jobs.unpacked(file)[1] == total % 2**64


def test_a_tick_is_timed_as_the_controller_answers_it_with_listed_effects_and_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cores: list[limits.TimedCore] = []

    def driven(rig: RigCore, core: limits.TimedCore, seconds: float) -> Run:
        cores.append(core)
        return run_closed_loop(rig, core, seconds)

    monkeypatch.setattr(limits, "run_closed_loop", driven)
    rows = limits.control_ticks(1, 0.5)
    assert [row.job for row in rows] == [limits.BASE, limits.LISTED]
    assert all(0.0 < row.ours < 0.1 for row in rows)
    assert [len(core.spent_s) for core in cores] == [250, 250]
    base, compensated = ({one.effect.name for one in c.law.plan.active} for c in cores)
    assert not base
    listed = ("coulomb_friction", "valve_deadband", "internal_leakage", "valve_spool_lag")
    assert compensated.issuperset(listed)


def test_works_take_turns_after_each_has_been_done_once() -> None:
    done: list[str] = []
    works = {name: partial(done.append, name) for name in "ab"}
    took = limits.in_turns(works, 2)
    assert done == ["a", "b"] * 3
    assert set(took) == set(works)


def test_every_installed_executable_is_started(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them by tests/test_docs_campaigns.py; here which they are, and some."""
    every = limits.executables()
    some = {"diagnose", "inspect", "recorder", "controller", "can_bridge"}
    assert some < set(every)
    with_help = {name: every[name] for name in sorted(some)}
    monkeypatch.setattr(limits, "executables", lambda: with_help)
    rows = limits.command_starts(bag, 1)
    assert [row.job for row in rows] == [limits.EMPTY, limits.HELP, limits.INSPECTED]
    empty, slowest, _ = rows
    assert empty.ours < slowest.ours
    assert slowest.peer.endswith(f"of {len(with_help)})")


#: What a command's help imports of what is heavy, where that is not easily helped: the parameters
#: of a controller's node are those of its core, and recorder and player are nodes.
_NEEDED = {"controller": {"scipy", "numba"}, "recorder": {"rclpy"}, "player": {"rclpy"}}


@pytest.mark.parametrize("name", limits.executables())
def test_help_imports_nothing_heavy(name: str) -> None:
    script = (
        f"import sys\nsys.argv = [{name!r}, '--help']\n"
        f"from {limits.executables()[name]} import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "print('\\n', *{'scipy', 'plotly', 'numba', 'rclpy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) > 3
    assert set(done.stdout.splitlines()[-1].split()) <= _NEEDED.get(name, set())


def test_results_that_differ_are_said_even_where_asserts_are_left_out() -> None:
    """A benchmark under `python -O` compares what it times all the same."""
    script = "from hydro_ident.bench.job import agree; agree(1 < 2, 'well'); agree(2 < 1, 'apart')"
    done = subprocess.run([sys.executable, "-O", "-c", script], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.endswith("AssertionError: apart\n")
