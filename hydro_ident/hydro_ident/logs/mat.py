"""MAT files as logs: vectors, matrices, structs, and those that dSPACE ControlDesk writes."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.file import Log, most_unfolded
from hydro_ident.logs.mat_hdf5 import is_hdf5, read_hdf5
from hydro_model.arrays import FloatArray

_HEADER_BYTES, _COMPRESSED = 128, 15
_MAX_NAMES = 12


def read_mat_log(path: Path) -> Log:
    """Read a MAT file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Log
        A vector by its name, a matrix as `name[1]` ..., a struct as `name.field`, an array of
        structs as `name[1].field` (Simulink's `signals` by their labels); of a struct with axes
        `X` and signals `Y`, as ControlDesk exports, the signals by their own names.

    Raises
    ------
    BagError
        No MAT file, one of version 7.3 where h5py is not installed, or one that unfolds to more
        than a log would.
    """
    try:
        content, objects = read_hdf5(path) if is_hdf5(path) else (_content(path), ())
        log = _log_of(path, content)
    except BagError:
        raise
    except Exception as error:  # these libraries raise what their parts raise: IndexError ...
        line = " ".join(str(error).split()) or type(error).__name__
        raise BagError(f"{path}: not a readable MAT file: {line[:400]}") from error
    if not objects:
        return log
    note = (
        f"{', '.join(objects[:_MAX_NAMES])}: objects of MATLAB's own, or sparse; save their"
        " numbers as arrays or structs"
    )
    if not log.columns:
        raise BagError(f"{path}: expected signals, found {note}")
    return replace(log, notes=(*log.notes, f"left out: {note}"))


def _content(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat, whosmat

    allowed = most_unfolded(path)
    _check_packed(path, allowed)
    if sum(math.prod(shape) for _, shape, _ in whosmat(path)) > allowed:
        raise ValueError(f"variables of more than {allowed} numbers")
    return dict(loadmat(path, squeeze_me=True, struct_as_record=True))


def _check_packed(path: Path, allowed: int) -> None:
    """Unfold the packed elements of a MAT file (versions 6 and 7) to nowhere and add them up."""
    with open(path, "rb") as stream:
        head = stream.read(_HEADER_BYTES)
        order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
        while order and len(tag := stream.read(8)) == 8:
            kind, count = struct.unpack(f"{order}II", tag)
            if kind == _COMPRESSED:
                allowed -= _unfolded(stream, count, allowed)
            else:
                stream.seek(count, 1)


def _unfolded(stream: IO[bytes], count: int, allowed: int) -> int:
    unpacker, total = zlib.decompressobj(), 0
    while count > 0 and (piece := stream.read(min(count, 1 << 16))):
        count -= len(piece)
        while piece:
            total += len(unpacker.decompress(piece, 1 << 20))
            if total > allowed:
                raise ValueError(f"it unfolds to more than {allowed} bytes")
            piece = unpacker.unconsumed_tail
    return total


def _log_of(path: Path, content: dict[str, Any]) -> Log:
    columns: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    deep: list[str] = []
    for name, value in content.items():
        if name.startswith("__"):
            continue
        names = getattr(np.asarray(value).dtype, "names", None) or ()
        if {"X", "Y"} <= set(names):
            _add_axes_and_signals(columns, units, clocks, np.asarray(value))
        else:
            _add_variable(columns, deep, name, value)
    notes = ["a struct of axes X and signals Y (dSPACE)"] if clocks else []
    if deep:
        notes.append(f"left out: {', '.join(deep[:_MAX_NAMES])}: of more than two dimensions")
    return Log(path, columns, units=units, clocks=clocks, notes=tuple(notes))


def _add_variable(columns: dict[str, FloatArray], deep: list[str], name: str, value: Any) -> None:
    """A variable's columns; what has more dimensions than a log is named in `deep`."""
    array = np.asarray(value)
    if array.dtype.names and array.ndim == 0:
        for field in array.dtype.names:
            _add_variable(columns, deep, f"{name}.{field}", array[field].item())
    elif array.dtype.names and array.ndim == 1:
        _add_elements(columns, deep, name, array)
    elif array.dtype.kind in "biuf" and array.ndim <= 1:
        columns[name] = np.atleast_1d(array).astype(np.float64)
    elif array.dtype.kind in "biuf" and array.ndim == 2:
        upright = array if array.shape[0] >= array.shape[1] else array.T
        for i in range(upright.shape[1]):
            columns[f"{name}[{i + 1}]"] = upright[:, i].astype(np.float64)
    elif array.dtype.names or array.dtype.kind in "biuf":
        deep.append(name)


def _add_elements(columns: dict[str, FloatArray], deep: list[str], name: str, array: Any) -> None:
    """An array of structs; of Simulink's `signals` the `values` by labels that differ."""
    fields = array.dtype.names
    simulink = "values" in fields
    labels = [str(one["label"]).strip() if "label" in fields else "" for one in array]
    by_label = all(labels) and "[]" not in labels and len(set(labels)) == len(labels)
    for k, one in enumerate(array):
        if simulink:
            own = f"{name}.{labels[k]}" if by_label else f"{name}[{k + 1}]"
            _add_variable(columns, deep, own, one["values"])
        else:
            for field in fields:
                _add_variable(columns, deep, f"{name}[{k + 1}].{field}", one[field])


def _add_axes_and_signals(
    columns: dict[str, FloatArray], units: dict[str, str], clocks: dict[str, str], value: Any
) -> None:
    """`X(i).Data` are time axes, `Y(k).Data` signals with `Name`, `Unit` and `XIndex`."""
    axes = np.atleast_1d(value["X"].item())
    times = [f"time[{i + 1}]" if len(axes) > 1 else "time" for i in range(len(axes))]
    for time, axis in zip(times, axes, strict=True):
        columns[time] = np.atleast_1d(axis["Data"]).astype(np.float64)
        _add_unit(units, time, axis)
    for signal in np.atleast_1d(value["Y"].item()):
        name = str(signal["Name"])
        if name in columns and "Path" in (signal.dtype.names or ()):
            name = f"{signal['Path']}/{name}"
        columns[name] = np.atleast_1d(signal["Data"]).astype(np.float64)
        _add_unit(units, name, signal)
        index = int(signal["XIndex"]) if "XIndex" in (signal.dtype.names or ()) else 1
        clocks[name] = times[min(max(index, 1), len(times)) - 1]


def _add_unit(units: dict[str, str], name: str, value: Any) -> None:
    unit = str(value["Unit"]).strip() if "Unit" in (value.dtype.names or ()) else ""
    if unit and unit != "[]":
        units[name] = unit
