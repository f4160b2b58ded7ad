"""Samples that no voltage follows from: how long the valves are shut after one, and when for good.

Such a sample is at 0 V, and the law begins anew behind it: with no velocity, and from 0 V. A
reading that comes and goes would open and shut the valves at up to half the rate of samples, by
several volts each time, and the oil with them.
"""

from __future__ import annotations

from collections import deque

#: Good samples in a row before anything is driven again: 50 ms at 500 Hz. By then the shipped
#: filters know the velocity, and shut valves have brought the arm to rest.
SETTLED = 25
#: The valves are shut for good as bad ones come among good ones for this many times
RECURS = 3
#: within this time.
RECURS_NS = 1_000_000_000


class BadSampleWatch:
    """Judges what the law says of samples, one by one.

    Attributes
    ----------
    shut : str
        Why the valves are at 0 V at the next sample whatever it says; empty where they are not.
    found : str
        What was wrong with the newest bad sample since `forget`.
    fault : str
        What came and went too often, until `forget`; empty where nothing did.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Driving begins anew with the next sample; no fault."""
        self.shut = self.found = self.fault = ""
        self._good = SETTLED
        self._times: deque[int] = deque(maxlen=RECURS)

    def judge(self, stamp_ns: int, found: str, *, anew: bool) -> str:
        """Look at a sample.

        Parameters
        ----------
        stamp_ns : int
        found : str
            Why no voltage follows from it; empty where one does.
        anew : bool
            The law's filters start with it: they do not know those before it.

        Returns
        -------
        str
            Why it is answered with 0 V; empty where it is not.
        """
        if found:
            self._bad(stamp_ns, found)
            return self.fault or self.shut
        said = self.shut
        # Over a gap the row does not go on: shut is for the filters to know the velocity.
        self._good = 1 if anew else self._good + 1
        if self._good == SETTLED:
            self.shut = ""
        return said

    def _bad(self, stamp_ns: int, found: str) -> None:
        # However many in a row, and however long: a reading that was lost, and came back once.
        if self._good:
            self._times.append(stamp_ns)
        self._good, self.found = 0, found
        self.shut = f"{found}; 0 V until {SETTLED} samples in a row are good"
        if len(self._times) == RECURS and stamp_ns - self._times[0] <= RECURS_NS:
            self.fault = (
                f"{found}; it came and went {RECURS} times in"
                f" {1e-9 * (stamp_ns - self._times[0]):.3f} s: latched until the controller is"
                " activated anew"
            )
