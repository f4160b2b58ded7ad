"""Coming to rest along a path: its time runs slower and slower until it stands still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_model.motion.paths import Path
from hydro_model.motion.paths_segments import Sample
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Slowing:
    """A path that is slowed from its speed to rest, whatever it was about to do.

    Path time passes at the rate ``r = 1 - 3 s^2 + 2 s^3`` with ``s = t / duration_s``, so half the
    duration of it passes. Only places of the path are passed, none beyond its end, and no faster
    than it would have been: ``v r``. Accelerations are ``a r^2 + v r'``; of what the limits allow
    (20 velocity limits in a second) r' takes at most 3 within half a second, while r^2 gives way.

    Attributes
    ----------
    path : Path
    from_s : float
        Time of the path at which it begins.
    duration_s : float
    polynomial : bool
    """

    path: Path
    from_s: float
    duration_s: float
    polynomial: bool = False

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration at `t`."""
        s = t / self.duration_s
        rate = 1.0 - s * s * (3.0 - 2.0 * s)
        slope = -6.0 * s * (1.0 - s) / self.duration_s
        passed_s = self.duration_s * s * (1.0 - s * s * (1.0 - 0.5 * s))
        position, velocity, acceleration = self.path.sample(self.from_s + passed_s)
        return position, rate * velocity, rate * rate * acceleration + slope * velocity

    def sample_many(self, times_s: FloatArray) -> Sample:
        """Position, velocity and acceleration at N times, (N, k) each."""
        rows = [self.sample(t) for t in times_s.tolist()]
        position, velocity, acceleration = (np.array(part) for part in zip(*rows, strict=True))
        return position, velocity, acceleration
