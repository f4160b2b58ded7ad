"""Memory that text and Parquet logs take: what is asked for is enough, refused where it lacks."""

from __future__ import annotations

import gzip
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

import hydro_ident.logs.text as reader
from hydro_ident.bag import memory
from hydro_ident.bag.memory import available_bytes
from hydro_ident.errors import BagError
from hydro_ident.logs.file import read_log
from hydro_ident.logs.memory import TextSize

MEASURED = """
import json, resource, sys
from pathlib import Path
import hydro_ident.logs.text
from hydro_ident.logs.file import read_log
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
read_log(Path(sys.argv[1]))
print(1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before))
"""


def _written(path: Path, cell: str, rows: int, columns: int) -> Path:
    names = ["t", *(f"c{i}" for i in range(columns - 1))]
    lines = [",".join([str(k), *[cell] * (columns - 1)]) for k in range(rows)]
    path.write_text("\n".join([",".join(names), *lines]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("cell", "rows", "columns"),
    [("1", 20_000, 10), ("-1.2345678901234567e-05", 20_000, 10), ("", 4_000, 50), ("", 99_000, 1)],
)
def test_what_is_asked_for_is_enough(tmp_path: Path, cell: str, rows: int, columns: int) -> None:
    path = _written(tmp_path / "log.csv", cell, rows, columns)
    size = TextSize()
    size.add(path.read_bytes())
    assert (size.count, size.lines) == (path.stat().st_size, rows + 1)
    assert size.cells == (rows + 1) * columns
    out = subprocess.run(
        [sys.executable, "-c", MEASURED, str(path)], capture_output=True, check=True
    )
    # What the interpreter itself needs for the first log is not the log's.
    assert int(json.loads(out.stdout)) < size.needed + 8_000_000


@pytest.mark.parametrize("sign", [",", ";", "\t", ""])
def test_blanks_that_pad_cells_are_no_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sign: str
) -> None:
    """Each had been counted as one, and a padded log was refused when it was packed."""
    rows, columns = 500, 9
    lines = [f"{sign} ".join([f"{k:15.3f}"] * columns) for k in range(rows)]
    text = "\n".join([f"{sign} ".join(f"{f'c{i}':>15s}" for i in range(columns)), *lines, ""])
    size = TextSize()
    for piece in (text[:1001], text[1001:2002], text[2002:], ""):
        size.add(piece.encode())
    # Blanks in front of a line may part it from nothing; what is counted is enough.
    assert (rows + 1) * columns <= size.cells <= (rows + 1) * (columns + 1) + 2
    wide = TextSize()
    wide.add(text.encode("utf-16-le"))
    assert wide.cells <= size.cells
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(text.encode()))
    monkeypatch.setattr(reader, "most_unfolded", lambda _: 3 * len(text))
    assert len(read_log(path).columns["c8"]) == rows


@pytest.mark.parametrize("packed", [False, True])
def test_a_text_that_does_not_fit_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packed: bool
) -> None:
    path = _written(tmp_path / "log.csv", "1", 1000, 5)
    size = TextSize()
    size.add(path.read_bytes())
    if packed:
        whole = path.read_bytes()
        path = tmp_path / "log.csv.gz"
        path.write_bytes(gzip.compress(whole))
    monkeypatch.setattr(memory, "available_bytes", lambda: size.needed)
    assert len(read_log(path).columns["t"]) == 1000
    monkeypatch.setattr(memory, "available_bytes", lambda: size.needed - 1)
    with pytest.raises(BagError, match="expected a log that fits into memory") as caught:
        read_log(path)
    assert "convert it in parts" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_parquet_file_that_does_not_fit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "log.parquet"
    remarks = ["remark " * 100] * 1000  # not read, and not counted
    parquet.write_table(pyarrow.table({"t": range(1000), "said": remarks}), path)
    monkeypatch.setattr(memory, "available_bytes", lambda: 24_000)
    assert list(read_log(path).columns) == ["t"]
    monkeypatch.setattr(memory, "available_bytes", lambda: 23_999)
    with pytest.raises(BagError, match="expected a log that fits into memory"):
        read_log(path)


def test_the_limit_of_the_process_counts() -> None:
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGESIZE")
    try:
        resource.setrlimit(resource.RLIMIT_AS, (used + (64 << 20), before[1]))
        assert 0 <= available_bytes() <= 64 << 20
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def test_where_nothing_is_known_nothing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_limits", lambda: iter(()))
    assert available_bytes() == 1 << 62
