"""What may be adapted online, and how far."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hydro_control.errors import ControlError

#: What can be adapted, in the order of reports.
KINDS = ("payload", "friction", "null_bias")


@dataclass(frozen=True, slots=True)
class AdaptationSettings:
    """Online adaptation of a few parameters; off by default.

    Everything is estimated where anything is, as friction left out would be taken for payload;
    `kinds` says which estimates the control law uses.

    Attributes
    ----------
    kinds : tuple of str
        Some of `KINDS`; empty: off.
    payload_kg : float
        Largest payload beyond the model's, of either sign.
    coulomb_n : float
        Largest Coulomb friction of a cylinder; the smallest is 0.
    viscous : float
        Largest change of a cylinder's viscous friction, either way, N s/m.
    null_bias : float
        Largest null bias of a valve, of either sign, normalised.
    ramp_s : float
        Shortest time in which a value used by the law may go from 0 to its largest.
    dead_zone_n : float
        Force errors up to this size change no estimate.
    """

    kinds: tuple[str, ...] = ()
    payload_kg: float = 100.0
    coulomb_n: float = 8.0e3
    viscous: float = 2.0e4
    null_bias: float = 0.02
    ramp_s: float = 1.0
    dead_zone_n: float = 200.0

    def __post_init__(self) -> None:
        unknown = [kind for kind in self.kinds if kind not in KINDS]
        if unknown or len(set(self.kinds)) < len(self.kinds):
            raise ControlError(
                f"adaptation: expected some of {', '.join(KINDS)}, each once,"
                f" found '{' '.join(self.kinds)}'"
            )
        for name in ("payload_kg", "coulomb_n", "viscous", "null_bias", "ramp_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ControlError(f"adaptation: {name} should be above 0, found {value}")
        if not (math.isfinite(self.dead_zone_n) and self.dead_zone_n >= 0.0):
            raise ControlError(
                f"adaptation: dead_zone_n should be 0 or more, found {self.dead_zone_n}"
            )

    @property
    def on(self) -> bool:
        """Whether anything is adapted."""
        return bool(self.kinds)


def kinds_of(text: str) -> tuple[str, ...]:
    """Kinds from the words of a parameter.

    >>> kinds_of("payload friction")
    ('payload', 'friction')
    """
    return tuple(text.replace(",", " ").split())
