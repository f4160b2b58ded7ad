"""MAT files of version 7.3 in the form in which scipy gives older ones; needs the package h5py.

Such a file is HDF5 behind a header of MATLAB: arrays transposed, structs as groups, arrays of
structs as references, texts as numbers of 16 bits. Only what MATLAB writes is followed: no link to
another file, no filter but its own, and nothing is unfolded before its size was counted.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hydro_ident.bag.memory import require
from hydro_ident.errors import BagError
from hydro_ident.logs.file import most_unfolded

if TYPE_CHECKING:
    import h5py

_MATLAB, _HDF5 = (b"\x00\x02IM", b"\x02\x00MI"), b"\x89HDF\r\n\x1a\n"
_NUMBERS = frozenset(["", "double", "single", "logical", *(f"int{n}" for n in (8, 16, 32, 64)),
                      *(f"uint{n}" for n in (8, 16, 32, 64))])  # fmt: skip
#: MATLAB packs by deflate; others that write its layout shuffle bytes and add a checksum.
_DEFLATE, _SHUFFLE, _CHECKSUM = 1, 2, 3
#: What is beside a chunk's numbers once it is unfolded: a checksum.
_BESIDE = 16
#: Groups may hold themselves, and one object may be named from many places.
_DEEPEST, _MOST_OBJECTS = 16, 100_000
_LONGEST_TEXT, _LONGEST_ATTRIBUTE = 10_000, 64
#: From which size an array is held against the memory that is free, bytes.
_LARGE = 1 << 20


def is_hdf5(path: Path) -> bool:
    """Whether a MAT file is one of version 7.3.

    Parameters
    ----------
    path : Path
    """
    with open(path, "rb") as stream:
        head = stream.read(128)
    return head[124:128] in _MATLAB or head.startswith(_HDF5)


def read_hdf5(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Variables of a MAT file of version 7.3.

    Parameters
    ----------
    path : Path

    Returns
    -------
    content : dict
        By name as `scipy.io.loadmat` gives them with `squeeze_me`; None for what holds no numbers.
    left_out : tuple of str
        Names of objects whose numbers only MATLAB knows: tables, time series.

    Raises
    ------
    BagError
        h5py is not there, or the file does not fit into memory.
    ValueError
        The file is damaged, larger than it could be, or no log.
    """
    try:
        import h5py
    except ImportError as error:
        raise BagError(
            f"{path}: MAT files of version 7.3 are HDF5, which needs the optional package h5py:"
            " python -m pip install h5py; or save it with '-v7' in MATLAB"
        ) from error
    # A log on a drive that knows no locks is read as well.
    with h5py.File(path, "r", locking=False) as file:
        content = _Content(path, file)
        return content.of_group(file, 0), tuple(content.left_out)


class _Content:
    """What is read of a file, and how much of it may still come."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        self.path, self.file = path, file
        self.file_bytes = path.stat().st_size
        self.most = self.allowed = most_unfolded(path)
        self.objects = 0
        self.left_out: list[str] = []

    def of_group(self, group: h5py.Group, depth: int) -> dict[str, Any]:
        from h5py import HardLink

        found = {}
        for name in group:
            if depth == 0 and name.startswith("#"):
                continue  # where references lead, and MATLAB's objects
            if not isinstance(group.get(name, getlink=True), HardLink):
                raise ValueError(f"'{name[:_LONGEST_ATTRIBUTE]}' is a link, which MATLAB has not")
            found[name] = self._value(group[name], depth + 1)
        return found

    def _value(self, item: Any, depth: int) -> Any:
        from h5py import Dataset, Group

        self.objects += 1
        if depth > _DEEPEST or self.objects > _MOST_OBJECTS:
            raise ValueError(f"more than {_DEEPEST} deep, or more than {_MOST_OBJECTS} objects")
        if isinstance(item, Group):
            if "MATLAB_sparse" in item.attrs:
                return self._leave_out(item)
            return _struct(self.of_group(item, depth))
        return self._array(item, depth) if isinstance(item, Dataset) else None

    def _array(self, dataset: h5py.Dataset, depth: int) -> Any:
        from h5py import check_ref_dtype

        kind = _class_of(dataset)
        if dataset.shape is None or "MATLAB_empty" in dataset.attrs:
            return "" if kind == "char" else np.empty(0)
        if check_ref_dtype(dataset.dtype) is not None:
            if kind:
                return None  # a cell array
            self._count(dataset)
            return _Several(self._value(self.file[ref], depth + 1) for ref in dataset[()].T.flat)
        if kind == "char":
            return self._text(dataset)
        if kind not in _NUMBERS or dataset.dtype.kind not in "biuf":
            return self._leave_out(dataset)
        self._count(dataset)
        return np.squeeze(dataset[()].T)

    def _text(self, dataset: h5py.Dataset) -> str:
        if dataset.dtype.kind != "u" or dataset.size > _LONGEST_TEXT:
            return ""
        self._count(dataset)
        units = np.asarray(dataset[()].T, dtype="<u2")
        return units.tobytes().decode("utf-16-le", "replace")

    def _leave_out(self, item: Any) -> None:
        self.left_out.append(str(item.name).lstrip("/")[:_LONGEST_ATTRIBUTE])

    def _count(self, dataset: h5py.Dataset) -> None:
        """See, before memory is taken, that an array is no larger than a log's could be."""
        packed = _filters(dataset)
        numbers = math.prod(dataset.shape)
        size = numbers * dataset.dtype.itemsize
        stored: list[Any] = []
        if dataset.chunks is not None:
            chunk = math.prod(dataset.chunks) * dataset.dtype.itemsize
            dataset.id.chunk_iter(stored.append)
            size = max(size, chunk * len(stored))
        self.allowed -= size
        if self.allowed < 0:
            raise ValueError(f"it unfolds to more than {self.most} bytes")
        if size > _LARGE:
            require(self.path, size + numbers * np.dtype(np.float64).itemsize)
        if _DEFLATE in packed:
            skipped = 1 << packed.index(_DEFLATE)
            for one in stored:
                self._check_chunk(dataset, one, chunk, whole=bool(one.filter_mask & skipped))

    def _check_chunk(self, dataset: h5py.Dataset, stored: Any, most: int, *, whole: bool) -> None:
        """HDF5 unfolds a chunk to whatever it holds: to nowhere first, up to what it may hold."""
        if stored.size > self.file_bytes:
            raise ValueError("a piece is larger than the file")
        if whole:
            return
        _, piece = dataset.id.read_direct_chunk(stored.chunk_offset)
        if len(zlib.decompressobj().decompress(piece, most + _BESIDE + 1)) > most + _BESIDE:
            raise ValueError(f"a piece of {most} bytes unfolds to more")


class _Several(list[Any]):
    """A field of an array of structs."""


def _struct(fields: Mapping[str, Any]) -> Any:
    """A struct, or an array of them, as scipy has it: an array with the fields' names."""
    dtype = [(name, object) for name in fields]
    columns = list(fields.values())
    if columns and all(isinstance(column, _Several) for column in columns):
        rows: Sequence[tuple[Any, ...]] = list(zip(*columns, strict=True))
        return np.array(rows, dtype=dtype)
    one = np.empty((), dtype=dtype)
    one[()] = tuple(None if isinstance(column, _Several) else column for column in columns)
    return one


def _class_of(item: h5py.Dataset) -> str:
    """MATLAB's class; empty where the file says none."""
    if "MATLAB_class" not in item.attrs:
        return ""
    known = item.attrs.get_id("MATLAB_class")
    if known.dtype.kind != "S" or known.shape != () or known.dtype.itemsize > _LONGEST_ATTRIBUTE:
        return "unknown"
    return bytes(item.attrs["MATLAB_class"]).decode("ascii", "replace")


def _filters(dataset: h5py.Dataset) -> list[int]:
    """By which filters an array is packed, in their order; its numbers are in this file."""
    made = dataset.id.get_create_plist()
    if dataset.is_virtual or made.get_external_count():
        raise ValueError("an array whose numbers are in other files")
    found = [made.get_filter(i)[0] for i in range(made.get_nfilters())]
    if set(found) - {_DEFLATE, _SHUFFLE, _CHECKSUM} or len(set(found)) < len(found):
        raise ValueError(f"packed by the filters {found}, which MATLAB does not use")
    return found
