"""What the controller is given at one stamp."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hydro_model.robot import FloatArray, Robot


@dataclass(frozen=True, slots=True)
class Sample:
    """What the sensors say at one stamp.

    Attributes
    ----------
    stamp_ns : int
    q : (n,) array
        Joint positions in the robot's order.
    p_a, p_b : (m,) array
        Absolute chamber pressures per cylinder in the robot's order, Pa.
    p_s, p_t : float or None
        Absolute supply and tank pressure; None takes the robot file's constants.
    """

    stamp_ns: int
    q: FloatArray
    p_a: FloatArray
    p_b: FloatArray
    p_s: float | None
    p_t: float | None

    @property
    def is_finite(self) -> bool:
        """Whether all readings are numbers: others are answered by 0 V."""
        rails = (0.0 if rail is None else rail for rail in (self.p_s, self.p_t))
        read = (*self.q.tolist(), *self.p_a.tolist(), *self.p_b.tolist(), *rails)
        return math.isfinite(sum(read))

    def gauge(self, robot: Robot) -> tuple[FloatArray, FloatArray, float, float]:
        """Pressures above the atmosphere's.

        Parameters
        ----------
        robot : Robot
            Its atmosphere, and its rails where none were read.

        Returns
        -------
        p_a, p_b : (m,) array
        p_s, p_t : float
            Pa.
        """
        atmosphere = robot.atmospheric_pressure_pa
        p_s = robot.supply_pressure_pa if self.p_s is None else self.p_s - atmosphere
        p_t = robot.tank_pressure_pa if self.p_t is None else self.p_t - atmosphere
        return self.p_a - atmosphere, self.p_b - atmosphere, p_s, p_t
