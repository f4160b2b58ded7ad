"""Two replays field by field: what differs, where, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

#: Relative, and absolute for what is about 0. Processors differ in the last digits, which the
#: diagnosis' searches pass on; the kernels of linear algebra, which differ by more, are those that
#: `scripts/golden.sh` chooses.
TOLERANCES = {"control": (1e-7, 1e-9), "diagnosis": (1e-4, 1e-9)}


def differences(kind: str, expected: Any, found: Any) -> list[str]:
    """Fields that differ.

    Parameters
    ----------
    kind : str
        Of `TOLERANCES`.
    expected, found : JSON values

    Returns
    -------
    list of str
        `where: expected this, found that`; empty where nothing does.
    """
    relative, absolute = TOLERANCES[kind]
    return list(_differing("", expected, found, relative, absolute))


def _differing(
    where: str, expected: Any, found: Any, relative: float, absolute: float
) -> Iterator[str]:
    if isinstance(expected, Mapping) and isinstance(found, Mapping):
        for key in dict.fromkeys((*expected, *found)):
            place = f"{where}.{key}" if where else str(key)
            if key not in found:
                yield f"{place}: expected it, found none"
            elif key not in expected:
                yield f"{place}: expected none, found it"
            else:
                yield from _differing(place, expected[key], found[key], relative, absolute)
    elif isinstance(expected, list) and isinstance(found, list):
        if len(expected) != len(found):
            yield f"{where}: expected {len(expected)} entries, found {len(found)}"
        for k, (one, other) in enumerate(zip(expected, found, strict=False)):
            yield from _differing(f"{where}[{k}]", one, other, relative, absolute)
    elif not _same(expected, found, relative, absolute):
        yield f"{where}: expected {expected!r}, found {found!r}"


def _same(expected: Any, found: Any, relative: float, absolute: float) -> bool:
    if type(expected) is float and type(found) in (int, float):
        return math.isclose(expected, found, rel_tol=relative, abs_tol=absolute)
    return type(expected) is type(found) and bool(expected == found)
