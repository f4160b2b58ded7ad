"""Whether the valves get what is commanded: commands beside applied voltages, stamp by stamp.

A bridge that is inactive or tripped applies 0 V whatever is commanded. A controller that went on
playing its path then would command the whole error at once when commands are applied again.
"""

from __future__ import annotations

import numpy as np

from hydro_model.robot import FloatArray

#: More stamps in a row than this with 0 V instead of the command: the commands are withheld.
MOST_WITHHELD = 10
#: So many stamps in a row at which no more than 0 V was asked for and applied: nothing is withheld
#: as far as can be told. A controller whose reference stays with the robot may ask for less than
#: the wire has steps for as long as that lasts.
IDLE = 500
#: Applied voltages up to this are 0 V.
ZERO_V = 1e-3
#: A command and what a wire of coarse steps (8 bits) makes of it, perhaps 0 V, differ by up to
#: this share of the rated voltage.
_STEP_SHARE = 5e-3
#: Stamps that wait for their other half.
_KEPT = 200


class AppliedWatch:
    """Pairs commands with what was applied, by stamp and in whatever order they come.

    As long as commands are applied, nothing it says changes, so answers do not depend on when
    applied voltages arrive.

    Parameters
    ----------
    rated_v : (m,) array
        Of the valves, in the order of commands.

    Attributes
    ----------
    withheld : bool
        The newest commands that asked for a voltage had no effect; no more once one has, nor after
        `IDLE` stamps at which 0 V was right.
    settled : bool
        False from when commands are withheld until one is applied, rounded as the wire rounds it.
    moved : bool
        A command of a moving reference was applied since `clear`.
    count : int
        Stamps so far at which 0 V was applied instead of the command.
    """

    def __init__(self, rated_v: FloatArray) -> None:
        self.count = 0
        self._step_v = _STEP_SHARE * rated_v
        self.clear()

    def clear(self) -> None:
        """A new beginning: nothing was commanded yet."""
        self.withheld = self.moved = False
        self.settled = True
        self._in_a_row = self._idle = 0
        self._commanded: dict[int, tuple[FloatArray, bool]] = {}
        self._applied: dict[int, FloatArray] = {}

    def commanded(self, stamp_ns: int, voltage_v: FloatArray, *, moving: bool) -> None:
        """A stamp was answered.

        Parameters
        ----------
        stamp_ns : int
        voltage_v : (m,) array
        moving : bool
            The reference moves at that stamp.
        """
        applied = self._applied.pop(stamp_ns, None)
        if applied is not None:
            self._judge(voltage_v, applied, moving=moving)
            return
        self._commanded[stamp_ns] = (voltage_v, moving)
        if len(self._commanded) > _KEPT:
            del self._commanded[next(iter(self._commanded))]

    def applied(self, stamp_ns: int, voltage_v: FloatArray) -> None:
        """What was applied at a stamp.

        Parameters
        ----------
        stamp_ns : int
        voltage_v : (m,) array
            In the order of commands.
        """
        command = self._commanded.pop(stamp_ns, None)
        if command is not None:
            self._judge(command[0], voltage_v, moving=command[1])
            return
        self._applied[stamp_ns] = voltage_v
        if len(self._applied) > _KEPT:
            del self._applied[next(iter(self._applied))]

    def _judge(self, commanded: FloatArray, applied: FloatArray, *, moving: bool) -> None:
        if np.max(np.abs(applied)) > ZERO_V:
            self._in_a_row, self.withheld = 0, False
            self.moved = self.moved or moving
            if np.all(np.abs(applied - commanded) <= self._step_v):
                self.settled = True
        elif np.any(np.abs(commanded) > self._step_v):
            self.count += 1
            self._in_a_row, self._idle = self._in_a_row + 1, 0
            if self._in_a_row > MOST_WITHHELD:
                self.withheld, self.settled = True, False
        elif self.withheld:
            self._idle += 1
            if self._idle == IDLE:
                self._in_a_row, self.withheld = 0, False
