"""Small bags that unfold to more than there is memory for: refused in a line, or streamed."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import zstandard

from hydro_ident.bag import memory
from hydro_ident.bag.mcap_records import CHANNEL, CHUNK, MAGIC, MESSAGE, SCHEMA
from hydro_ident.bag.reader import read_bag
from hydro_ident.errors import BagError
from hydro_msgs_docs.cdr import JOINT_STATE, encode

MIB = 1 << 20
NAMES = ("lift", "tilt", *(f"j{i}" for i in range(198)))
#: A process that may take so many bytes more than it has once its command is imported.
LIMITED = """
import importlib, os, resource, sys
module, left, *arguments = sys.argv[1:]
main = importlib.import_module(module).main
import numba, scipy.optimize, scipy.signal
used = int(open("/proc/self/statm").read().split()[0]) * os.sysconf("SC_PAGESIZE")
resource.setrlimit(resource.RLIMIT_AS, (used + int(left), resource.RLIM_INFINITY))
sys.argv[1:] = arguments
sys.exit(main())
"""
STREAMED = """
import os, resource, sys
from hydro_ident.bag.playback import contents_of, messages
used = int(open("/proc/self/statm").read().split()[0]) * os.sysconf("SC_PAGESIZE")
resource.setrlimit(resource.RLIMIT_AS, (used + int(sys.argv[1]), resource.RLIM_INFINITY))
print(contents_of(sys.argv[2]).channels[0].topic, sum(1 for _ in messages(sys.argv[2])))
"""


def _record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _described() -> bytes:
    schema = struct.pack("<H", 1) + _text(JOINT_STATE) + _text("ros2msg") + _text("")
    channel = struct.pack("<HH", 1, 1) + _text("/joint_states") + _text("cdr") + _text("")
    return _record(SCHEMA, schema) + _record(CHANNEL, channel)


def _chunk(raw: bytes) -> bytes:
    packed = zstandard.ZstdCompressor().compress(raw)
    head = struct.pack("<QQQI", 0, 0, len(raw), 0) + _text("zstd")
    return _record(CHUNK, head + struct.pack("<Q", len(packed)) + packed)


def _message() -> bytes:
    data = encode(JOINT_STATE, 7, {"position": np.ones(len(NAMES))}, names=NAMES)
    return _record(MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5) + data)


def _bag(path: Path, chunk_bytes: int, chunks: int) -> int:
    """Write a bag; what cannot be packed makes room for what can, within the allowed ratio."""
    message = _message()
    count = chunk_bytes // len(message)
    padding = np.random.default_rng(3).bytes(chunk_bytes * chunks // 100)
    chunk = _chunk(message * count)
    path.write_bytes(MAGIC + _described() + _record(0x80, padding) + chunk * chunks)
    return count * chunks


@pytest.fixture(scope="module")
def bomb(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """4.5 MB that unfold to 420 MiB; and the number of messages."""
    path = tmp_path_factory.mktemp("bomb") / "bomb.mcap"
    count = _bag(path, 4 * MIB, 105)
    assert path.stat().st_size < 5 * MIB
    return path, count


def _run(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )


@pytest.mark.parametrize(
    "command",
    [
        pytest.param("tracking", marks=pytest.mark.thorough),
        # Where they lack something, they say that first.
        pytest.param(
            "identify", marks=[pytest.mark.thorough, pytest.mark.needs("clarabel", "plotly")]
        ),
        pytest.param("diagnose", marks=pytest.mark.needs("plotly")),
    ],
)
def test_a_bag_that_does_not_fit_is_refused_in_one_line(
    bomb: tuple[Path, int], tmp_path: Path, command: str
) -> None:
    out = ["--out", tmp_path / "out"] if command in ("identify", "diagnose") else []
    arguments = [bomb[0], "--robot", "xs031", *out]
    done = _run(LIMITED, f"hydro_ident.commands.{command}", 400 * MIB, *arguments)
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"{command}: {bomb[0]}: expected a bag that fits into memory (0.")


def test_looking_it_over_takes_flat_memory(bomb: tuple[Path, int]) -> None:
    path, count = bomb
    done = _run(LIMITED, "hydro_ident.commands.inspect", 150 * MIB, path, "--robot", "xs031")
    assert done.returncode == 0, done.stderr
    assert f" {count} messages" in done.stdout


def test_playing_it_back_takes_flat_memory(bomb: tuple[Path, int]) -> None:
    path, count = bomb
    done = _run(STREAMED, 150 * MIB, path)
    assert done.stdout.split() == ["/joint_states", str(count)], done.stderr


def test_a_chunk_that_does_not_fit_is_refused_where_messages_are_streamed(tmp_path: Path) -> None:
    path = tmp_path / "chunk.mcap"
    _bag(path, 100 * MIB, 1)
    done = _run(STREAMED, 150 * MIB, path)
    assert "expected a chunk that fits into memory" in done.stderr
    assert "write it with smaller chunks" in done.stderr


def test_memory_is_asked_for_before_it_is_taken(
    bomb: tuple[Path, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def plenty() -> int:
        asked.append(1)
        return 10**10

    monkeypatch.setattr(memory, "available_bytes", plenty)
    assert len(read_bag(bomb[0]).series["/joint_states"]) == bomb[1]
    assert len(asked) > 20
    # One number a name, four times: as it is kept, as columns, and in the work on them.
    needed = 8 * len(NAMES) * bomb[1]
    monkeypatch.setattr(memory, "available_bytes", lambda: 2 * needed)
    with pytest.raises(BagError, match="that it takes a further"):
        read_bag(bomb[0])


def test_what_the_messages_alone_do_not_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Columns of names that few messages carry: small until the table is made."""
    path = tmp_path / "bag.mcap"
    names = [f"n{i}" for i in range(16)]
    records = [
        _record(
            MESSAGE,
            struct.pack("<HIQQ", 1, 0, 5, 5)
            + encode(JOINT_STATE, k, {"position": [1.0]}, names=(names[k % 16],)),
        )
        for k in range(8000)
    ]
    path.write_bytes(MAGIC + _described() + b"".join(records))
    monkeypatch.setattr(memory, "available_bytes", lambda: 8000 * 16 * 8)
    with pytest.raises(BagError, match="expected a bag that fits into memory"):
        read_bag(path)
    monkeypatch.setattr(memory, "available_bytes", lambda: 4 * 8000 * 16 * 8)
    assert read_bag(path).series["/joint_states"].fields["position"].shape == (8000, 16)
