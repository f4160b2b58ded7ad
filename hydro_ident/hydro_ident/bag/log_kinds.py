"""Kinds of files by their endings: what `convert` reads, and how the others become that.

What is given in the place of a bag or of a log is told what to try next.
"""

from __future__ import annotations

import shlex
from pathlib import Path

#: Texts, which may also be packed as `.gz`; and what has a reader of its own.
TEXT = (".csv", ".txt", ".tsv", ".lvm", ".asc")
BINARY = (".mat", ".parquet")

_ASAM = "an ASAM measurement file: export it as CSV or MAT from the program that recorded it"
_LABVIEW = "a measurement file of LabVIEW: export it as .lvm or CSV from LabVIEW or DIAdem"
_WORKBOOK = "a workbook: save its sheet as CSV"
_HDF5 = "an HDF5 file: write its signals as CSV, MAT (MATLAB: '-v7') or Parquet"
_FRAMES = "frames of a bus: export the signals decoded from them as CSV or MAT"
_PACKED = "a packed file: unpack it"
_OTHER = {
    **dict.fromkeys((".mf4", ".mdf"), _ASAM),
    **dict.fromkeys((".tdms", ".tdm"), _LABVIEW),
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods"), _WORKBOOK),
    **dict.fromkeys((".h5", ".hdf5"), _HDF5),
    **dict.fromkeys((".blf", ".trc"), _FRAMES),
    **dict.fromkeys((".gz", ".zip", ".7z", ".bz2", ".xz", ".zst"), _PACKED),
}
_UNKNOWN = "export it as CSV or MAT from the program that wrote it"
_BAG = "a bag already: inspect, identify and diagnose take it as it is"
_SQLITE, _MCAP = ".db3", ".mcap"


def is_text(path: Path) -> bool:
    """Whether a file is a text log by its ending.

    Parameters
    ----------
    path : Path
    """
    kind = path.suffix.lower()
    return (Path(path.stem).suffix.lower() if kind == ".gz" else kind) in TEXT


def is_log(path: Path) -> bool:
    """Whether `convert` reads a file, by its ending.

    Parameters
    ----------
    path : Path
    """
    return is_text(path) or path.suffix.lower() in BINARY


def instead_of_log(path: Path) -> str:
    """How what is no log that `convert` reads becomes one, for a message.

    Parameters
    ----------
    path : Path

    Returns
    -------
    str
    """
    kind = path.suffix.lower()
    if kind == _MCAP or (path.is_dir() and any(path.glob("*.mcap"))):
        return _BAG
    if path.is_dir():
        return "give it a log of the folder"
    if kind == _SQLITE:
        return _of_sqlite(path.parent)
    return _OTHER.get(kind, _UNKNOWN)


def instead_of_bag(path: Path) -> str:
    """How what is no bag becomes one, to go behind a message.

    Parameters
    ----------
    path : Path
        A file, or a folder without MCAP files.

    Returns
    -------
    str
        Empty of a folder in which nothing tells.
    """
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.is_file())
        if any(file.suffix.lower() == _SQLITE for file in files):
            return f"; it is {_of_sqlite(path)}"
        # A `.txt` beside no bag is more often about what lies there than a log.
        logs = [file for file in files if is_log(file) and file.suffix.lower() != ".txt"]
        return f", but '{logs[0].name}'{instead_of_bag(logs[0])}" if logs else ""
    if is_log(path):
        name = shlex.quote(str(path))
        return (
            f"; by its ending it is a log: 'convert {name} --suggest MAP.yaml' writes a mapping to"
            f" look at, and 'convert {name} --map MAP.yaml --out BAG' a bag"
        )
    kind = path.suffix.lower()
    if kind == _SQLITE:
        return f"; it is of {_of_sqlite(path.parent)}"
    if kind in _OTHER:
        return f"; by its ending it is {_OTHER[kind]}, then use convert"
    if kind == _MCAP:
        return "; its first bytes are gone: copy it once more from where it was recorded"
    return "; give a folder of rosbag2 or its .mcap file, or make one of a log with convert"


def instead_of_storage(path: Path, storage: str) -> str:
    """How a bag of another storage becomes one of MCAP, to go behind a message.

    Parameters
    ----------
    path : Path
        Of the bag.
    storage : str

    Returns
    -------
    str
        Empty where the storage is not known.
    """
    return f"; it is {_of_sqlite(path)}" if storage == "sqlite3" else ""


def _of_sqlite(bag: Path) -> str:
    return (
        "a bag in SQLite, which rosbags rewrites:"
        f" 'rosbags-convert --src {shlex.quote(str(bag))} --dst NEW --dst-storage mcap'"
    )
