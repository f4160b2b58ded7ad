"""Memory that reading a log takes, held against what there is before it is taken."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hydro_ident.bag import memory

#: What a text log takes at most: for each byte (raw, decoded, in lines), cell and line. Measured
#: at the readers of this package; logs of long lines take about half of it.
_PER_BYTE, _PER_CELL, _PER_LINE = 4, 72, 450
_MARKS = (b",", b";", b"\t", b"|")
_LINE_ENDS = (b"\n", b"\r")


@dataclass(slots=True)
class TextSize:
    """How large a text log is, counted piece by piece.

    Attributes
    ----------
    count, cells, lines : int
        Bytes, and at most so many cells and lines.
    """

    count: int = 0
    cells: int = 0
    lines: int = 0

    def add(self, piece: bytes) -> None:
        """Count a piece.

        Parameters
        ----------
        piece : bytes
        """
        ends = sum(piece.count(mark) for mark in _LINE_ENDS)
        self.count += len(piece)
        self.lines += ends
        # Blanks part columns only where no other sign does, and any number of them parts two.
        self.cells += ends + max(sum(map(piece.count, _MARKS)), _runs(piece))

    @property
    def needed(self) -> int:
        """Memory to read it, bytes."""
        return _PER_BYTE * self.count + _PER_CELL * self.cells + _PER_LINE * self.lines


def _runs(piece: bytes) -> int:
    """How many runs of blanks a piece has, of signs of two bytes, too."""
    blank = np.frombuffer(piece.replace(b"\0", b""), dtype=np.uint8) == ord(" ")
    return int(np.count_nonzero(blank[1:] & ~blank[:-1])) + int(blank[:1].sum())


def read_text(path: Path) -> bytes:
    """A text file, once it is known to fit into memory as a table.

    Parameters
    ----------
    path : Path

    Raises
    ------
    BagError
        It does not fit.
    OSError
    """
    if path.stat().st_size * (_PER_BYTE + _PER_CELL + _PER_LINE) > memory.available_bytes():
        size = TextSize()
        with open(path, "rb") as stream:
            while piece := stream.read(1 << 20):
                size.add(piece)
        memory.require(path, size.needed)
    return path.read_bytes()
