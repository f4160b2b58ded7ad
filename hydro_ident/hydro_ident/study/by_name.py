"""Members of a list that a command names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from hydro_ident.errors import IdentError


class _Listed(Protocol):
    @property
    def name(self) -> str: ...


T = TypeVar("T", bound=_Listed)


def chosen(listed: Sequence[T], names: Sequence[str]) -> tuple[T, ...]:
    """Those that are named, in the order of the names; all where none is.

    Parameters
    ----------
    listed : sequence
        Each with its `name`.
    names : sequence of str

    Raises
    ------
    IdentError
        A name is not in the list.
    """
    known = {one.name: one for one in listed}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise IdentError(f"expected names of the list, found '{unknown[0]}' (see --list)")
    return tuple(known[name] for name in names) or tuple(listed)
