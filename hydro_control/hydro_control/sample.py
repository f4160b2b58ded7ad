"""What the controller is given at one stamp."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_model.robot import FloatArray


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
