"""The sensors whose samples are checked for outliers, each in its own unit."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_ident.estimate.signals.signal_survey import Sensor, SignalSurvey
from hydro_model.robot import Robot

#: What stands out by more than this many deviations of white noise is a spike.
SPIKE_SIGMAS = 8.0
#: ... beyond this share of the supply: a step of a valve bends a pressure within a sample.
PRESSURE_SHARE = 0.02
#: ... and of the size of a torque: a drive's ripple and reversals are no white noise.
EFFORT_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class Watched:
    """A sensor with the size from which its samples stand out.

    Attributes
    ----------
    name : str
        In messages.
    field : str
        Of the recording.
    column : int
    sensor : Sensor
    resolution : float
        The robot file's; 0 where that says nothing in this sensor's unit: the smallest change
        that was seen then stands for it.
    floor : float
        Below which nothing is a spike.
    """

    name: str
    field: str
    column: int
    sensor: Sensor
    resolution: float = 0.0
    floor: float = 0.0

    @property
    def noise(self) -> float:
        """Standard deviation against which spikes are seen; 0 where nothing is known of it."""
        step = self.resolution or self.sensor.smallest_change
        return max(self.sensor.noise(step), step)

    @property
    def spikes(self) -> float:
        """Share of the samples that stand out."""
        return self.sensor.deviations.share_above(SPIKE_SIGMAS * self.noise + self.floor)


def watched_sensors(robot: Robot, signals: SignalSurvey) -> tuple[Watched, ...]:
    """Every sensor that the survey met and that an equation uses."""
    bar = robot.sensors.pressure_resolution_pa
    floor = PRESSURE_SHARE * robot.supply_pressure_pa
    found = []
    for i, joint in enumerate(robot.joints):
        step, effort = robot.encoder_steps[i], signals.effort[i]
        found.append(Watched(joint.name, "q", i, signals.q[i], float(step)))
        least = EFFORT_SHARE * effort.usual_size
        found.append(Watched(f"{joint.name} effort", "effort", i, effort, floor=least))
    for i, cylinder in enumerate(robot.cylinders):
        name = cylinder.name
        found.append(Watched(f"{name}/a", "p_a", i, signals.p_a[i], bar, floor))
        found.append(Watched(f"{name}/b", "p_b", i, signals.p_b[i], bar, floor))
        found.append(Watched(f"{name} stroke", "stroke", i, signals.stroke[i]))
    if robot.cylinders:
        found.append(Watched("supply", "supply", 0, signals.supply, bar, floor))
        found.append(Watched("tank", "tank", 0, signals.tank, bar, floor))
    return tuple(one for one in found if one.sensor.count)
