"""What pressure transducers of the usual class are off by, as shares of their range."""

from __future__ import annotations

from hydro_model.robot import Robot

#: Slow drift of a pressure transducer as a share of its range, that of a kelvin's change: usual
#: ones are compensated to 0.01 to 0.04 % of the range per kelvin.
DRIFT = 2.0e-4
#: What transducers of the usual class (0.25 % of the range at most) are off by within a recording,
#: rms, as a share of their range: noise of a tenth of a second and longer, hysteresis, linearity.
ACCURACY = 1.25e-3
#: Standard deviation of a zero as a share of the range, of transducers whose zeros were read with
#: the pump off and taken off: `DRIFT` since then, and what that reading itself was off by. Data
#: sheets allow several times as much of those whose zeros never were.
ZERO = 2.5e-4


def zero_pa(robot: Robot) -> float:
    """Standard deviation of the zeros of a robot's transducers.

    Parameters
    ----------
    robot : Robot
        Its file's range, or the one that is taken where it has none.
    """
    return ZERO * robot.sensors.pressure_range_pa
