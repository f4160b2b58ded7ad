"""A disk that fills up, or a file that may not grow, at any moment of a bag's writing.

At its begin, in a chunk, at a new file, while it is closed: what was written before is read.
"""

from __future__ import annotations

import errno
import io
import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag import writer
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import BagError
from hydro_msgs_docs.cdr import JOINT_STATE

TOPIC, STEP_NS = "/joint_states", 100_000_000
#: Files of four chunks of two cycles; the second is the larger one.
CYCLES, SPLIT_NS = 16, 8 * STEP_NS
SHORT, LONG = 10, 40


def _values(k: int) -> list[float]:
    return [k + 0.25] * (SHORT if k < CYCLES // 2 else LONG)


def _write(path: Path) -> int:
    """Write the bag as the recorder does; errno of what ended it, 0 where it was closed."""
    try:
        writer = BagWriter(path, {"robot": "xs031"}, compression="none", split_ns=SPLIT_NS)
    except BagError as error:
        return getattr(error.__cause__, "errno", -1)
    try:
        writer.add_topic(TOPIC, JOINT_STATE, text="x")
        for k in range(CYCLES):
            names = [f"j{i}" for i in range(len(_values(k)))]
            writer.write_stamped(TOPIC, k * STEP_NS, {"position": _values(k)}, names=names)
        writer.close()
    except OSError as error:
        writer.abandon()
        return error.errno or -1
    return 0


def _read(path: Path) -> tuple[list[int], bool]:
    """The cycles of a bag, which are right, and whether a loss is said; none where refused."""
    try:
        bag = read_bag(path)
    except BagError:
        return [], True
    series = bag.series[TOPIC]
    cycles = [int(stamp) // STEP_NS for stamp in series.stamp_ns]
    for row, k in enumerate(cycles):
        values = series.fields["position"][row]
        np.testing.assert_array_equal(values[np.isfinite(values)], _values(k))
    return cycles, bool(bag.losses)


def _on_small_disks(disk: Path, every: Sequence[str]) -> None:
    """Write and read the bag on a disk of each size; a line of JSON tells what came of it."""
    for options in every:
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", disk], check=True)
        ended = _write(disk / "bag")
        files = sorted(file.name for file in disk.glob("bag/*"))
        print(json.dumps([options, ended, *_read(disk / "bag"), files]), flush=True)
        subprocess.run(["umount", disk], check=True)


@contextmanager
def _files_up_to(size: int) -> Iterator[None]:
    """No file of this process may grow beyond it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.thorough
def test_whatever_byte_a_file_may_not_grow_beyond_the_rest_is_read(tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    assert _write(whole) == 0
    one, two = (file.stat().st_size for file in sorted(whole.glob("*.mcap")))
    assert one < two
    last = 0
    # Every 23rd: records are no multiples of it, so every kind of place is met.
    for size in range(0, two, 23):
        path = tmp_path / "bag"
        with _files_up_to(size):
            ended = _write(path)
        assert ended == errno.EFBIG, size
        assert not list(path.glob("*.part"))
        cycles, said = _read(path)
        assert said, size
        assert cycles == list(range(len(cycles))), size
        assert len(cycles) >= last, size
        last = len(cycles)
        shutil.rmtree(path, ignore_errors=True)
    assert last == CYCLES  # its end alone was missing


@pytest.mark.parametrize("limit", ["size={}k", "nr_inodes={}"])
def test_a_disk_that_is_full_at_a_new_file_or_at_the_end_leaves_the_rest(
    tmp_path: Path, limit: str
) -> None:
    """Of a page more each time, and with room for a file more."""
    if (
        shutil.which("unshare") is None
        or subprocess.run(
            ["unshare", "-rm", "mount", "-t", "tmpfs", "none", str(tmp_path)], check=False
        ).returncode
    ):
        pytest.skip("this system lets nobody mount a disk in a namespace of one's own")
    each = [limit.format(n) for n in (range(4, 28, 4) if "size" in limit else range(2, 6))]
    command = ["unshare", "-rm", sys.executable, __file__, str(tmp_path), *each]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert [options for options, *_ in told] == each
    last = 0
    for options, ended, cycles, said, files in told:
        assert ended in (0, errno.ENOSPC), options
        assert said == (ended != 0), options
        assert cycles == list(range(len(cycles))), options
        assert len(cycles) >= last, options
        assert not [name for name in files if name.endswith(".part")], options
        last = len(cycles)
    assert told[-1][1] == 0
    # Also ended in its second file, and when all was written but what closes it.
    ways = [(len(files), len(cycles)) for _, ended, cycles, _, files in told if ended]
    assert (2, CYCLES) in ways


if __name__ == "__main__":
    _on_small_disks(Path(sys.argv[1]), sys.argv[2:])


class _Failing(io.FileIO):
    """A file on a disk that fails from some byte on: written up to there, and never again."""

    def __init__(self, path: Path, left: list[int], code: int) -> None:
        super().__init__(path, "x")
        self._left, self._code = left, code

    def write(self, data: Any) -> int:
        written = min(len(memoryview(data)), self._left[0])
        self._left[0] -= written
        if not written:
            raise OSError(self._code, os.strerror(self._code))
        return super().write(memoryview(data)[:written])


@pytest.mark.parametrize("code", [errno.EROFS, errno.EIO])
def test_a_disk_that_fails_while_it_is_written_leaves_what_came_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    """One that the system makes read-only after an error, or that has the error."""
    assert _write(tmp_path / "whole") == 0
    size = sum(file.stat().st_size for file in (tmp_path / "whole").glob("*.mcap"))
    read = []
    for bytes_left in range(0, size, 101):
        left, path = [bytes_left], tmp_path / "bag"

        def fragile(name: Path, mode: str, left: list[int] = left) -> io.BufferedWriter:
            assert mode == "xb"
            return io.BufferedWriter(_Failing(name, left, code))

        monkeypatch.setattr(writer, "open", fragile, raising=False)
        assert _write(path) == code, bytes_left
        cycles, said = _read(path)
        assert said, bytes_left
        assert cycles == list(range(len(cycles))), bytes_left
        read.append(len(cycles))
        shutil.rmtree(path, ignore_errors=True)
    assert read == sorted(read)
    assert read[-1] == CYCLES  # its end alone was missing
