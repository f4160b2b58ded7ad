"""What the controller says of a sample, and of all so far."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_control.law.output import Output
from hydro_control.motion.required_motion import Reference


@dataclass(frozen=True, slots=True)
class Answer:
    """What follows from a sample.

    Attributes
    ----------
    stamp_ns : int
    output : Output
    reference : Reference
    """

    stamp_ns: int
    output: Output
    reference: Reference


@dataclass(slots=True)
class Counts:
    """What happened so far.

    Attributes
    ----------
    answered, repeated, missed, old, faults, refused, withheld, not_followed : int
        Stamps answered; repeats of the newest stamp; stamps that never came; stamps older than
        the newest; samples answered by 0 V because of a value, of one shortly before, or of what
        is latched; references refused; stamps at which the valves got 0 V instead of the
        command; motions dropped as the arm did not follow.
    """

    answered: int = 0
    repeated: int = 0
    missed: int = 0
    old: int = 0
    faults: int = 0
    refused: int = 0
    withheld: int = 0
    not_followed: int = 0
