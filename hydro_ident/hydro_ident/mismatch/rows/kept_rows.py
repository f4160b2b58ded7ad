"""Rows that are kept by what they follow from, the ones asked for last."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

from hydro_model.robot import FloatArray

#: Bytes that are kept at a time: some hundred columns of a minute, some of an hour.
_KEPT_BYTES = 8 << 20


@dataclass(slots=True)
class KeptRows:
    """Arrays of one size by their keys; not to be changed."""

    _kept: dict[Hashable, FloatArray] = field(default_factory=dict)

    def of(self, key: Hashable, make: Callable[[], FloatArray]) -> FloatArray:
        """What is kept by a key, or made now.

        Parameters
        ----------
        key : hashable
            All that the values follow from.
        make : callable
        """
        values = self._kept.pop(key, None)
        if values is None:
            values = make()
        while self._kept and (len(self._kept) + 1) * values.nbytes > _KEPT_BYTES:
            self._kept.pop(next(iter(self._kept)))
        self._kept[key] = values
        return values
