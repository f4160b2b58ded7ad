"""What the controller says of a sample, and of all so far."""

from __future__ import annotations

from collections import deque
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


class Untold:
    """The newest fault, and the newest notes, until somebody took them to be told.

    Who looks now and then would miss what is over by then. One thread adds, another takes.
    """

    def __init__(self) -> None:
        self._faults: deque[str] = deque(maxlen=1)
        self._notes: deque[tuple[str, ...]] = deque(maxlen=1)

    def add(self, output: Output) -> None:
        """A sample was answered.

        Parameters
        ----------
        output : Output
        """
        if output.fault:
            self._faults.append(output.fault)
        if output.notes:
            self._notes.append(output.notes)

    def take(self) -> tuple[str, tuple[str, ...]]:
        """What was added since it was taken last.

        Returns
        -------
        fault : str
        notes : tuple of str
            Empty where there was none.
        """
        # Its length tells that there is one: nobody else takes any.
        fault = self._faults.pop() if self._faults else ""
        return fault, self._notes.pop() if self._notes else ()
