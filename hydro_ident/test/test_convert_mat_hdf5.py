"""MAT files of version 7.3: what MATLAB writes is read; nothing else is followed or unfolded."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from hydro_ident.bag import memory
from hydro_ident.commands.convert import run
from hydro_ident.errors import BagError
from hydro_ident.logs.file import read_log

h5py = pytest.importorskip("h5py", reason="h5py is not installed")

HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Mar  2 09:30:00 2026"
T = np.arange(40) * 0.01


class Matlab:
    """Writes what MATLAB writes: a header, transposed arrays, groups, references, 16-bit texts."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = h5py.File(path, "w", userblock_size=512)

    def __enter__(self) -> Matlab:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()
        with open(self.path, "r+b") as stream:
            stream.write(HEADER.ljust(116) + bytes(8) + b"\x00\x02IM")

    def put(self, at: Any, name: str, value: object, **options: object) -> Any:
        """One variable or field, of the class that it has in MATLAB."""
        if isinstance(value, Mapping):
            return self._struct(at, name, value)
        if isinstance(value, Sequence) and not isinstance(value, str):
            return self._struct_array(at, name, value)
        if isinstance(value, str):
            kind, array = "char", np.frombuffer(value.encode("utf-16-le"), dtype="<u2")
        else:
            array = np.asarray(value)
            kind = {"float64": "double", "float32": "single"}.get(
                array.dtype.name, array.dtype.name
            )
        upright = array.reshape(-1, 1) if array.ndim < 2 and kind != "char" else array
        made = at.create_dataset(name, data=np.atleast_2d(upright).T, **options)
        made.attrs["MATLAB_class"] = np.bytes_(kind)
        return made

    def _struct(self, at: Any, name: str, value: Mapping[str, object]) -> Any:
        made = at.create_group(name)
        made.attrs["MATLAB_class"] = np.bytes_("struct")
        for field, inner in value.items():
            self.put(made, field, inner)
        return made

    def _struct_array(self, at: Any, name: str, value: Sequence[Mapping[str, object]]) -> Any:
        made = at.create_group(name)
        made.attrs["MATLAB_class"] = np.bytes_("struct")
        away = self.file.require_group("#refs#")
        for field in value[0]:
            refs = [self.put(away, f"o{len(away)}", one[field]).ref for one in value]
            made.create_dataset(field, data=np.array([refs], dtype=h5py.ref_dtype).T)
        return made


def signal(name: str, data: np.ndarray, index: int) -> dict[str, object]:
    return {"Name": name, "Data": data, "Unit": "deg", "XIndex": float(index), "Path": "Model"}


def test_it_reads_as_the_same_variables_of_version_7(tmp_path: Path) -> None:
    axes = [{"Name": "fast", "Data": T}, {"Name": "slow", "Data": T[:9]}]
    signals = [signal("q", np.sin(T), 1), signal("p", T[:9], 2)]
    variables: dict[str, Any] = {
        "t": T,
        "u": np.arange(40, dtype=np.int16).reshape(1, 40),
        "m": np.arange(12.0).reshape(6, 2),
        "square": np.arange(9.0, dtype=np.float32).reshape(3, 3),
        "rec": {"p": T + 1.0, "inner": {"temp": T + 30.0}, "said": "words"},
        "remark": "Prüfstand 3",
    }
    desk: dict[str, Any] = {"X": axes, "Y": signals, "Description": "made up"}
    traces = [{"values": T + k, "dimensions": 1.0, "label": f"trace {k}"} for k in range(2)]
    scope: dict[str, Any] = {"time": T, "signals": traces, "blockName": "crane/Scope"}
    x, y, simulink = (
        np.array([tuple(row.values()) for row in rows], dtype=[(k, object) for k in rows[0]])
        for rows in (axes, signals, traces)
    )
    structs = {"rec1": {**desk, "X": x, "Y": y}, "scope": {**scope, "signals": simulink}}
    savemat(tmp_path / "old.mat", {**variables, **structs})
    with Matlab(tmp_path / "new.mat") as matlab:
        for name, value in {**variables, "rec1": desk, "scope": scope}.items():
            matlab.put(matlab.file, name, value)
    old, new = (read_log(tmp_path / f"{name}.mat") for name in ("old", "new"))
    assert set(new.columns) == set(old.columns) >= {"m[2]", "rec.inner.temp", "q", "time[2]"}
    assert {"scope.time", "scope.signals.trace 0", "scope.signals.trace 1"} < set(new.columns)
    for name, column in old.columns.items():
        np.testing.assert_array_equal(new.columns[name], column, err_msg=name)
    assert (new.units, new.clocks) == (old.units, old.clocks)
    assert new.units["q"] == "deg"


@pytest.mark.parametrize("options", [{"compression": 3}, {"compression": 9, "shuffle": True},
                                     {"compression": 1, "fletcher32": True}, {}])  # fmt: skip
def test_packed_arrays_are_unfolded_and_become_a_bag(
    options: dict[str, Any], tmp_path: Path
) -> None:
    log, mapping = tmp_path / "log.mat", tmp_path / "map.yaml"
    with Matlab(log) as matlab:
        for name, column in (("t", T), ("q_deg", 30.0 + np.sin(T))):
            chunks = {"chunks": (1, 16)} if options else {}
            matlab.put(matlab.file, name, column, **chunks, **options)
    np.testing.assert_array_equal(read_log(log).columns["q_deg"], 30.0 + np.sin(T))
    assert run([str(log), "--suggest", str(mapping)]) == 0
    assert run([str(log), "--map", str(mapping), "--out", str(tmp_path / "bag")]) == 0


def test_what_holds_no_numbers_is_left_out_and_objects_are_named(tmp_path: Path) -> None:
    with Matlab(tmp_path / "log.mat") as matlab:
        matlab.put(matlab.file, "t", T)
        for name, kind in (("table", "timetable"), ("cells", "cell"), ("empty", "double")):
            values = [1, 2] if kind == "double" else [3707764736, 2, 1, 1, 5, 1]
            made = matlab.put(matlab.file, name, np.array(values, dtype=np.uint32))
            made.attrs["MATLAB_class"] = np.bytes_(kind)
        made.attrs["MATLAB_empty"] = np.uint8(1)
        matlab.put(matlab.file, "complex", T + 1j)
        matlab.file.create_group("sparse").attrs["MATLAB_sparse"] = np.uint64(5)
    log = read_log(tmp_path / "log.mat")
    assert {name for name, column in log.columns.items() if len(column)} == {"t"}
    [note] = log.notes
    assert note.startswith("left out: cells, complex, sparse, table: objects of MATLAB's own")


def test_a_file_of_objects_alone_says_what_to_save(tmp_path: Path) -> None:
    with Matlab(tmp_path / "log.mat") as matlab:
        made = matlab.put(matlab.file, "run", np.array([3707764736, 2], dtype=np.uint32))
        made.attrs["MATLAB_class"] = np.bytes_("timetable")
    with pytest.raises(BagError, match=r"expected signals, found run: objects .* save their"):
        read_log(tmp_path / "log.mat")


def fill_values(file: Any, _: Path) -> None:
    file.create_dataset("q", shape=(1, 1 << 40), dtype="f8", chunks=(1, 1 << 20), compression=1)


def many_references(file: Any, _: Path) -> None:
    made = file.create_dataset("a", data=np.zeros((1, 1 << 20)), compression=9)
    refs = np.full((1, 80), made.ref, dtype=h5py.ref_dtype)
    file.create_group("s").create_dataset("x", data=refs)


def a_chunk_that_unfolds_further(file: Any, _: Path) -> None:
    made = file.create_dataset("q", shape=(1, 8), dtype="f8", chunks=(1, 8), compression=1)
    made.id.write_direct_chunk((0, 0), zlib.compress(bytes(50_000_000)))


def large_chunks_of_a_small_array(file: Any, _: Path) -> None:
    made = file.create_dataset(
        "q", shape=(1, 2), maxshape=(1, None), dtype="f8", chunks=(1, 20_000_000), compression=1
    )
    made[0] = 1.0


def a_group_in_itself(file: Any, _: Path) -> None:
    group = file.create_group("s")
    group["s"] = group


def a_link_to_another_file(file: Any, folder: Path) -> None:
    with h5py.File(folder / "secret.h5", "w") as other:
        other["q"] = T
    file["q"] = h5py.ExternalLink(str(folder / "secret.h5"), "/q")


def numbers_of_another_file(file: Any, folder: Path) -> None:
    (folder / "secret").write_bytes(T.tobytes())
    file.create_dataset("q", (1, 40), "f8", external=[(str(folder / "secret"), 0, 320)])


def a_virtual_array(file: Any, folder: Path) -> None:
    with h5py.File(folder / "secret.h5", "w") as other:
        other["q"] = T
    layout = h5py.VirtualLayout(shape=(40,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(folder / "secret.h5"), "q", shape=(40,))
    file.create_virtual_dataset("q", layout)


def another_filter(file: Any, _: Path) -> None:
    file.create_dataset("q", data=T[None], chunks=(1, 40), compression="lzf")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (fill_values, "unfolds to more than"),
        (many_references, "unfolds to more than"),
        (a_chunk_that_unfolds_further, "a piece of 64 bytes unfolds to more"),
        (large_chunks_of_a_small_array, "unfolds to more than"),
        (a_group_in_itself, "more than 16 deep"),
        (a_link_to_another_file, "is a link"),
        (numbers_of_another_file, "numbers are in other files"),
        (a_virtual_array, "numbers are in other files"),
        (another_filter, "which MATLAB does not use"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_hostile_file_is_refused_in_one_line(make: Any, message: str, tmp_path: Path) -> None:
    with Matlab(tmp_path / "log.mat") as matlab:
        make(matlab.file, tmp_path)
    with pytest.raises(BagError, match=message) as refused:
        read_log(tmp_path / "log.mat")
    assert "not a readable MAT file" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_does_not_fit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Matlab(tmp_path / "log.mat") as matlab:
        matlab.put(matlab.file, "q", np.arange(200_000.0))
    monkeypatch.setattr(memory, "available_bytes", lambda: 3_200_000)
    assert len(read_log(tmp_path / "log.mat").columns["q"]) == 200_000
    monkeypatch.setattr(memory, "available_bytes", lambda: 3_199_999)
    with pytest.raises(BagError, match="expected a log that fits into memory"):
        read_log(tmp_path / "log.mat")


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_file_that_was_cut_is_refused_in_one_line(share: float, tmp_path: Path) -> None:
    file = tmp_path / "log.mat"
    with Matlab(file) as matlab:
        matlab.put(matlab.file, "q", np.arange(2000.0))
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(BagError, match="not a readable MAT file") as refused:
        read_log(file)
    assert "\n" not in str(refused.value)


def test_edited_copies_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    file = tmp_path / "log.mat"
    with Matlab(file) as matlab:
        matlab.put(matlab.file, "t", T, chunks=(1, 16), compression=3, shuffle=True)
        desk = {"X": [{"Name": "time", "Data": T}], "Y": [signal("q", T, 1), signal("p", T, 1)]}
        matlab.put(matlab.file, "rec", desk)
    whole, refused = file.read_bytes(), []
    for seed in range(200):
        rng, edited = np.random.default_rng(seed), bytearray(whole)
        for at in rng.integers(512, len(whole) - 4, 4):
            kind = rng.integers(3)
            edited[at : at + 4] = (b"\xff" * 4, b"\x01\0\0\0", rng.bytes(4))[kind]
        file.write_bytes(edited)
        try:
            read_log(file)
        except BagError as error:
            refused.append(str(error))
    assert 50 < len(refused) < 200
    assert not any("\n" in said for said in refused)
