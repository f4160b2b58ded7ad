"""The side file of true states: one row per cycle, never on a topic.

While the rig runs, rows go to `FILE.part`: a line of JSON, then little-endian doubles. At the end
that becomes `FILE`, a compressed npz, in one rename. After a kill the part file is what is left,
and reads just as well.
"""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_model.command_line.output import unwritable
from hydro_model.robot import FloatArray

ROWS_PER_WRITE = 250
SCHEMA = "hydro_hw_bridge/truth_log/1"


@dataclass(frozen=True, slots=True)
class TruthRecord:
    """What a side file holds.

    Attributes
    ----------
    names : tuple of str
        As `RigCore.truth_names`.
    rows : (N, k) array
        SI, pressures gauge.
    facts : dict
        Robot, truth, seed and what else the writer told.
    complete : bool
        False for the remains of a rig that was killed.
    """

    names: tuple[str, ...]
    rows: FloatArray
    facts: dict[str, Any]
    complete: bool

    def column(self, name: str) -> FloatArray:
        """One column (N,); raises BridgeError naming the known ones."""
        if name not in self.names:
            raise BridgeError(
                f"truth file: no column '{name}', expected one of {', '.join(self.names)}"
            )
        return self.rows[:, self.names.index(name)]

    def columns(self, prefix: str) -> FloatArray:
        """All columns `prefix/...` in order, (N, number of them)."""
        picked = [i for i, name in enumerate(self.names) if name.startswith(f"{prefix}/")]
        return self.rows[:, picked]


class TruthLog:
    """Writes a side file.

    Parameters
    ----------
    path : Path
        What it is called in the end; must not exist.
    names : tuple of str
    facts : dict
        JSON values.

    Raises
    ------
    BridgeError
        The file exists already or its folder cannot be written.
    """

    def __init__(self, path: Path, names: tuple[str, ...], facts: dict[str, Any]) -> None:
        self._path = path
        self._part = part_of(path)
        self._names = names
        self._facts = facts
        self._pending: list[FloatArray] = []
        if path.exists():
            raise BridgeError(f"truth file {path} exists already, expected a new name")
        head = {"schema": SCHEMA, "names": list(names), "facts": facts}
        try:
            self._stream = self._part.open("wb")
            self._stream.write(json.dumps(head).encode() + b"\n")
            self._stream.flush()
        except OSError as error:
            raise BridgeError(f"truth file {unwritable(path, error)}") from error

    def append(self, row: FloatArray) -> None:
        """Add the row of one cycle."""
        self._pending.append(row)
        if len(self._pending) >= ROWS_PER_WRITE:
            self._write()

    def _write(self) -> None:
        if self._pending:
            self._stream.write(np.array(self._pending, dtype="<f8").tobytes())
            self._stream.flush()
            self._pending.clear()

    def close(self) -> None:
        """Turn the part file into the final one."""
        if self._stream.closed:
            return
        self._write()
        self._stream.close()
        rows = _read_part(self._part).rows
        temporary = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            with temporary.open("wb") as stream:
                np.savez_compressed(
                    stream,
                    schema=np.array(SCHEMA),
                    names=np.array(self._names),
                    facts=np.array(json.dumps(self._facts)),
                    rows=rows,
                )
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(self._path)
        except OSError as error:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise BridgeError(
                f"truth file {self._path} cannot be written: {error.strerror};"
                f" the rows are in {self._part}"
            ) from error
        self._part.unlink()

    def __enter__(self) -> TruthLog:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def part_of(path: Path) -> Path:
    """Where the rows of a running rig are."""
    return path.with_name(f"{path.name}.part")


def read_truth_log(path: str | Path) -> TruthRecord:
    """Read a side file, or what a killed rig left of it.

    Parameters
    ----------
    path : str or Path
        As given to the rig.

    Returns
    -------
    TruthRecord

    Raises
    ------
    BridgeError
        There is none, or it is no truth file.
    """
    path = Path(path)
    try:
        if not path.exists() and part_of(path).exists():
            return _read_part(part_of(path))
        with np.load(path, allow_pickle=False) as data:
            if str(data["schema"]) != SCHEMA:
                raise BridgeError(f"{path}: expected schema {SCHEMA}, found '{data['schema']}'")
            names = tuple(str(name) for name in data["names"])
            return TruthRecord(names, data["rows"], json.loads(str(data["facts"])), True)
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise BridgeError(f"{path}: expected a truth file of sim_rig, found: {error}") from error


def _read_part(path: Path) -> TruthRecord:
    head, _, body = path.read_bytes().partition(b"\n")
    facts = json.loads(head)
    if not isinstance(facts, dict) or facts.get("schema") != SCHEMA:
        raise ValueError("no truth file")
    names = tuple(facts["names"])
    width = 8 * len(names)
    whole = len(body) - len(body) % width
    rows = np.frombuffer(body[:whole], dtype="<f8").reshape(-1, len(names))
    return TruthRecord(names, np.array(rows), facts["facts"], False)
