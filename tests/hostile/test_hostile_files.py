"""Files made to do harm: nothing is executed, no memory exhausted."""

from __future__ import annotations

import gzip
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard

from hydro_ident.bag.mcap_records import CHANNEL, CHUNK, MAGIC, MESSAGE, SCHEMA
from hydro_ident.study.fuzz.targets import NAME, shipped_mapping
from hydro_msgs_docs.cdr import JOINT_STATE, encode

#: Reads (path, target): what was said, and the notes beside a bag.
Read = Callable[[Path, str], str]


def _record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _described() -> bytes:
    schema = struct.pack("<H", 1) + _text(JOINT_STATE) + _text("ros2msg") + _text("")
    channel = struct.pack("<HH", 1, 1) + _text("/joint_states") + _text("cdr") + _text("")
    return _record(SCHEMA, schema) + _record(CHANNEL, channel)


def _message(data: bytes) -> bytes:
    return _record(MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5) + data)


def _chunk(packed: bytes, size: int, name: str = "zstd") -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + _text(name)
    return _record(CHUNK, head + struct.pack("<Q", len(packed)) + packed)


def _packed(piece: bytes, times: int) -> bytes:
    packer = zstandard.ZstdCompressor().compressobj(size=len(piece) * times)
    return b"".join(packer.compress(piece) for _ in range(times)) + packer.flush()


SOUND = _described() + _message(encode(JOINT_STATE, 7, {"position": [1.0]}, names=("lift",)))
MIB = 1 << 20


def _names(k: int) -> bytes:
    names = tuple(f"name_{k}_{i}" for i in range(10))
    return _message(encode(JOINT_STATE, k, {"position": [0.0] * 10}, names=names))


def _two_of_many(k: int) -> bytes:
    names = (f"n{k % 991}", f"m{k % 31}")
    data = encode(JOINT_STATE, k, {"position": [0.0, 0.0]}, names=names, frame_id=f"{k}")
    return _message(data)


def _endless_text() -> bytes:
    message = bytearray(encode(JOINT_STATE, 7, {"position": [1.0]}, names=("lift",)))
    message[12:16] = b"\xff\xff\xff\xff"  # length of frame_id
    return _message(bytes(message))


#: Name -> bytes behind the magic, and what has to be said.
BAGS: dict[str, tuple[Callable[[], bytes], str]] = {
    "zeros": (lambda: SOUND + _chunk(_packed(bytes(MIB), 200), 200 * MIB), "declares 209715200"),
    "zeros that fit": (
        lambda: SOUND + _chunk(_packed(bytes(MIB), 64), 64 * MIB),
        "ends inside a record",
    ),
    "many messages": (
        lambda: SOUND + _chunk(_packed(_message(b"") * 4096, 20), 20 * 4096 * 31),
        "could not be decoded",
    ),
    "many malformed records": (
        lambda: SOUND + _chunk(_packed(_record(CHANNEL, b"") * 4096, 4), 4 * 4096 * 9),
        "more losses",
    ),
    "other names in every message": (
        lambda: SOUND + b"".join(_names(k) for k in range(3000)),
        "at most 1024 names",
    ),
    "another layout in every message": (
        lambda: SOUND + b"".join(_two_of_many(k) for k in range(20_000)),
        "expected messages of the same names",
    ),
    "endless record": (lambda: SOUND + struct.pack("<BQ", 5, 1 << 63), "cut off inside a record"),
    "endless text": (lambda: SOUND + _endless_text(), "could not be decoded"),
    "endless mapping": (
        lambda: SOUND + _record(0x0C, _text("hydro") + b"\xff\xff\xff\xff"),
        "is malformed",
    ),
}


@pytest.mark.parametrize("name", BAGS)
def test_bags_that_unfold_or_claim_to_be_large(read: Read, tmp_path: Path, name: str) -> None:
    make, expected = BAGS[name]
    path = tmp_path / "hostile.mcap"
    path.write_bytes(MAGIC + make())
    assert expected in read(path, "bag")


def _deep(count: int) -> str:
    return "\n".join("  " * k + f"a{k}:" for k in range(count))


YAML: dict[str, tuple[str, str]] = {
    "a command": ("a: !!python/object/apply:os.system ['touch HERE']", "could not determine"),
    "an import": ("a: !!python/module:antigravity x", "could not determine"),
    "merges": (
        "a: &a {" + ", ".join(f"k{i}: 1" for i in range(1000)) + "}\n"
        "b: {<<: [" + ", ".join(["*a"] * 2000) + "]}",
        "aliases unfold to more than",
    ),
    "itself": ("a: &a [1, *a]", "contains itself"),
    "base 60": ("a: " + "59:" * 200_000 + "59", "more than 400 digits"),
    "digits": ("robot: x\ntip_link: y\nurdf: z.urdf\ngravity_m_s2: [" + "9" * 390 + ", 0, 0]", ""),
    "depth": (_deep(600), "nested too deeply"),
    "twice": ("robot: a\nrobot: b", "appears more than once"),
    "empty tag": ("a: !!int ''", "not valid YAML"),
    "no time": ("a: !!timestamp x", "not valid YAML"),
    # What stands behind is not looked at any more.
    "many keys": ("".join(f"k{k}: 1\n" for k in range(300_000)) + "]", "more than 50000 values"),
    "many items": ("a: [" + "1," * 300_000 + "}", "more than 50000 values"),
}


@pytest.mark.parametrize("name", YAML)
def test_yaml_that_grows_loops_or_runs(read: Read, tmp_path: Path, name: str) -> None:
    text, expected = YAML[name]
    canary = tmp_path / "canary"
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace("HERE", str(canary)), encoding="utf-8")
    said = read(path, "robot")
    assert said
    assert expected in said
    assert not canary.exists()


def test_the_same_in_metadata_yaml_leaves_the_messages_readable(
    read: Read, tmp_path: Path
) -> None:
    (tmp_path / "beside.mcap").write_bytes(MAGIC + SOUND)
    path = tmp_path / "metadata.yaml"
    for name in ("a command", "merges", "itself"):
        path.write_text(YAML[name][0], encoding="utf-8")
        said = read(path, "bag_metadata")
        assert said.startswith(" | metadata.yaml is not usable"), name


URDF = {
    "laughs": (
        '<!DOCTYPE r [<!ENTITY a0 "ha">'
        + "".join(
            f'<!ENTITY a{k} "&a{k - 1 if k else ""};&a{k - 1 if k else ""};">' for k in range(30)
        )
        + ']><robot name="&a29;"/>'
    ),
    "another file": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>',
    "depth": "<robot>" * 100_000,
}


@pytest.mark.parametrize("name", URDF)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_xml_that_grows_nests_or_reads_other_files(
    read: Read, tmp_path: Path, name: str, encoding: str
) -> None:
    path = tmp_path / "case.urdf"
    path.write_text(URDF[name], encoding=encoding)
    said = read(path, "urdf")
    assert "document type" in said or "nested deeper" in said
    assert "root:" not in said


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (": 8 ", ": 9000000000 "),
        ("|16@", "|1600000000@"),
        (": 0|", ": 99999999999|"),
        ("(0.0001,0)", "(1e-300,0)"),
        ("(0.0001,0)", "(0,0)"),
    ],
)
def test_frames_and_signals_of_absurd_size(read: Read, tmp_path: Path, old: str, new: str) -> None:
    text = shipped_mapping().with_name(f"{NAME}.dbc").read_text(encoding="utf-8")
    if old.startswith("("):
        text, count = re.subn(r"\([-0-9.e]+,[-0-9.e]+\)", new, text)
        assert count
    else:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "case.dbc"
    path.write_text(text, encoding="utf-8")
    assert "expected" in read(path, "dbc")


LOGS = {
    "one line": (lambda: gzip.compress(b"t,a\n" + b"0" * (64 * MIB), 1), ".csv.gz", "lines of at"),
    "remarks": (
        lambda: gzip.compress(b"t,a\n" + (b"#" * (MIB - 1) + b"\n") * 90, 6),
        ".csv.gz",
        "packed log of at most",
    ),
    "long cell": (lambda: b"t,a\n0," + b"1" * 200_000, ".csv", "field larger than"),
    "open quote": (lambda: b't,a\n0,"1\n2,3\n', ".csv", "found"),
    "zero": (lambda: b"t,a\n0,\x00\n", ".csv", "found"),
    "not packed": (lambda: b"t,a\n0,1\n", ".csv.gz", "cannot be read"),
}


@pytest.mark.parametrize("name", LOGS)
def test_logs_that_unfold_or_do_not_end(read: Read, tmp_path: Path, name: str) -> None:
    make, suffix, expected = LOGS[name]
    path = tmp_path / f"case{suffix}"
    path.write_bytes(make())
    assert expected in read(path, "csv")


def test_a_text_log_that_does_not_fit_into_memory(read: Read, tmp_path: Path) -> None:
    path = tmp_path / "case.csv"
    with open(path, "wb") as stream:
        stream.write(b"t,a\n")
        for _ in range(32):
            stream.write(b"1,2\n" * (MIB // 4))
    assert "expected a log that fits into memory" in read(path, "csv")


def test_a_parquet_file_of_more_rows_than_fit_into_memory(read: Read, tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "case.parquet"
    rows = pyarrow.table({"t": pyarrow.nulls(2 * MIB, pyarrow.float64())})
    with parquet.ParquetWriter(path, rows.schema) as writer:
        for _ in range(64):
            writer.write_table(rows)
    assert path.stat().st_size < MIB
    assert "expected a log that fits into memory" in read(path, "mat")


def test_a_matlab_file_that_unfolds(read: Read, tmp_path: Path) -> None:
    packer = zlib.compressobj()
    packed = b"".join(packer.compress(bytes(MIB)) for _ in range(160)) + packer.flush()
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path = tmp_path / "case.mat"
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    assert "unfolds to more than" in read(path, "mat")
