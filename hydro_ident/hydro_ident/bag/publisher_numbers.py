"""Messages that publishers numbered and the middleware did not deliver.

A publisher numbers its messages 1, 2, 3 ... and the middleware hands each over with its number,
but rclpy (of Jazzy) does not say whose it is. Where several publish on a topic, what was counted
up to is therefore a set of numbers, one per publisher, and a message goes on from the largest of
them below its own. Numbers so assigned never lie above the true ones: once each publisher has been
heard, at most as much is counted as was lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

#: Numbers kept of publishers that are no longer there, at least.
_MOST_KEPT = 16


@dataclass(slots=True)
class PublisherNumbers:
    """What the publishers of one topic counted up to."""

    #: The one heard last is the last.
    _last: list[int] = field(default_factory=list)

    def missing_before(self, number: int, publishers: Callable[[], int]) -> int:
        """Messages that were lost before this one, at least.

        Parameters
        ----------
        number : int
            That its publisher gave it; 0 where the middleware tells none.
        publishers : callable
            How many publishers the topic has; asked where a message follows upon none.

        Returns
        -------
        int
        """
        if number <= 0:
            return 0
        before = max((last for last in self._last if last < number), default=0)
        missing = 0
        if before == number - 1 and before:
            self._last.remove(before)
        else:
            count = publishers()
            # One that has not been heard yet, or that began anew, has lost nothing we know of.
            if before and len(self._last) >= count:
                self._last.remove(before)
                missing = number - before - 1
            del self._last[: max(0, len(self._last) + 1 - max(count, _MOST_KEPT))]
        self._last.append(number)
        return missing
