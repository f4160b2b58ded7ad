"""What the amplifiers may hold by now: by what left, and by what they say that they took. Pure."""

from __future__ import annotations

from collections import deque

from hydro_hw_bridge.gate.gate_limits import GateLimits

#: Amplifiers without a valid frame for so long are off, by their watchdog.
WATCHDOG_S = 0.05
#: Cycles after which a frame that nobody has heard is lost: twice what a command may be old.
PATIENCE = 10
#: Frames kept: more than leave within the watchdog's time, one or two in a cycle.
_KEPT = 64
#: What rounding may add to a step that is exactly the largest.
ROUNDING_V = 1e-9


class HeldVoltages:
    """Every voltage that a valve may stand at, from the newest frame surely taken on.

    Frames do not overtake each other, so of those under way since the last count the newest
    taken is the n-th or a later one where n were taken; and what stays open for `PATIENCE`
    cycles in a row is lost. A frame that comes twice in the place of another is taken for that.

    Parameters
    ----------
    limits : GateLimits
    """

    def __init__(self, limits: GateLimits) -> None:
        self._zero = (0.0,) * len(limits.valve_names)
        # Their watchdog ends what is not heard; what it does is known a command's age later.
        self._patience = round(WATCHDOG_S / limits.period_s) + limits.max_age_cycles
        self._patience_s = self._patience * limits.period_s
        self.forget()

    def forget(self) -> None:
        """Nothing was sent: the valves are at 0 V."""
        self._spoke = False
        self._unheard = 0
        self._frames: deque[tuple[float, ...]] = deque([self._zero], _KEPT)
        self._open: deque[int] = deque(maxlen=PATIENCE)

    def sent(self, voltages: tuple[float, ...], *, told: bool) -> None:
        """A frame left.

        Parameters
        ----------
        voltages : tuple of float
            V per valve; 0 V where it has enable off.
        told : bool
            The amplifiers tell what they took; where they do not, it is what they hold.
        """
        self._spoke = True
        if not told:
            self._frames.clear()
        self._frames.append(voltages)

    def took(self, frames: int, since: int, counter: int) -> None:
        """The amplifiers told a count.

        Parameters
        ----------
        frames : int
            Taken since the count before.
        since, counter : int
            Sample counters, without wrap, of the cycles of that count and of this one.
        """
        cycles = counter - since
        if frames:
            self._unheard = max(self._unheard - cycles, 0)
            self._drop(frames)
        elif len(self._frames) > 1:
            self._unheard = min(self._unheard + cycles, self._patience + 1)
        # One that is always under way changes nothing, and is usual where answers take a cycle.
        self._open.append(len(self._frames) - 2)
        if frames and len(self._open) == PATIENCE and (lost := min(self._open)) > 0:
            # What was open all the while is not under way any more.
            self._drop(lost)
            self._open.clear()

    def rest(self) -> None:
        """The amplifiers are off, and hold nothing of what they did not take."""
        self._unheard = 0

    def _drop(self, frames: int) -> None:
        """So many of the oldest are not the newest taken."""
        for _ in range(min(frames, len(self._frames) - 1)):
            self._frames.popleft()

    @property
    def complaint(self) -> str:
        """Why it is not known what the amplifiers do; empty where it is known well enough.

        Counted are cycles of device time in which they took nothing of what was under way, less
        those in which they did.
        """
        if self._unheard <= self._patience:
            return ""
        return f"the amplifiers took no valve frame for {1e3 * self._patience_s:.0f} ms"

    def towards(
        self, wanted: tuple[float, ...], before: tuple[float, ...], most_v: float
    ) -> tuple[float, ...]:
        """As much of a step as the valves may see at once, whichever frame they hold.

        Parameters
        ----------
        wanted, before : tuple of float
            V per valve: the output that is meant, and the one before it.
        most_v : float
            Largest change at a valve at once, V.

        Returns
        -------
        tuple of float
            Each between `before` and `wanted`, both included, whatever the amplifiers say.
        """
        if not self._spoke:
            return wanted
        held = tuple(zip(*self._frames, strict=True))
        return tuple(
            _within(value, last, max(of) - most_v, min(of) + most_v)
            for value, last, of in zip(wanted, before, held, strict=True)
        )


def _within(wanted: float, before: float, lowest: float, highest: float) -> float:
    """As near to a value, from the one before it, as a range allows; not moved where none does."""
    if lowest - ROUNDING_V <= wanted <= highest + ROUNDING_V:
        return wanted
    if lowest > highest:
        return before
    low, high = min(before, wanted), max(before, wanted)
    return min(max(min(max(wanted, lowest), highest), low), high)
