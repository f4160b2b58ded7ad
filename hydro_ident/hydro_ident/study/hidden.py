"""What a case hides: an effect of the truth plant, its size in one number, and where it acts.

An effect's size is one scalar at a stated operating point, since the truth plant and the
diagnosis write the same physics in different forms. `Hidden.apply` puts it into a machine; the
shape of the form (speeds, places, signs) is drawn from a generator given to it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from hydro_hw_bridge.rig.extras import AxisExtras
from hydro_hw_bridge.rig.payload import Payload
from hydro_hw_bridge.rig.truth import CylinderTruth, Truth, ValveTruth
from hydro_model.robot import FloatArray, Robot

Scope = Literal["cylinder", "robot"]
#: Speed, pressure, load and rate of the operating points.
SPEED_M_S, PRESSURE_PA, LOAD_N, RATE_RAD_S, FLOW_M3_S = 0.05, 5.0e6, 2.0e4, 0.3, 1.0e-3


#: Which of a run's speeds is its usual fast one, and the least that is called fast.
_FAST, _LEAST_FAST_M_S = 0.95, 0.01


@dataclass(frozen=True, slots=True)
class Scene:
    """What a machine does in a run before anything is hidden in it, N samples.

    Attributes
    ----------
    duration_s : float
    stroke_m, lever, pressure_a, pressure_b : (N, m) array
    tip_height_m : (N,) array
    inertia : (n,) array
        About each joint at the middle of its range, kg m^2.
    """

    duration_s: float
    stroke_m: FloatArray
    lever: FloatArray
    pressure_a: FloatArray
    pressure_b: FloatArray
    tip_height_m: FloatArray
    inertia: FloatArray

    def fast_m_s(self, index: int) -> float:
        """Usual fast speed of a cylinder's piston."""
        stroke = self.stroke_m[:, index]
        speed = np.abs(np.diff(stroke)) * len(stroke) / self.duration_s
        return max(float(np.quantile(speed, _FAST)), _LEAST_FAST_M_S)


@dataclass(frozen=True, slots=True)
class Machine:
    """A machine with what is recorded of it.

    Attributes
    ----------
    robot : Robot
        As the file given to the diagnosis describes it.
    truth : Truth
    payload : Payload or None
    lines_recorded : bool
        Supply and tank pressure are.
    """

    robot: Robot
    truth: Truth
    payload: Payload | None = None
    lines_recorded: bool = True


Build = Callable[[Machine, Scene, int, float, np.random.Generator], Machine]


@dataclass(frozen=True, slots=True)
class Hidden:
    """An effect that may be hidden in a machine.

    Attributes
    ----------
    name : str
        Of CONTRACT.md, or of an effect outside the catalogue.
    low, high : float
        Physical range of the size.
    unit, at : str
        Unit of the size, and the operating point it is stated at.
    build : callable
        ``(machine, scene, cylinder index, size, generator) -> machine``.
    scope : {"cylinder", "robot"}
    known : bool
        Stands in the catalogue.
    needs : callable
        ``(machine, cylinder index) -> bool``: whether the machine can have it.
    shows : callable
        ``(machine, scene, cylinder index) -> bool``: whether the run is one that it is at work in.
    linear : bool
        Its trace in the recordings grows like its size.
    """

    name: str
    low: float
    high: float
    unit: str
    at: str
    build: Build
    scope: Scope = "cylinder"
    known: bool = True
    needs: Callable[[Machine, int], bool] = field(default=lambda machine, index: True)
    shows: Callable[[Machine, Scene, int], bool] = field(default=lambda m, scene, index: True)
    linear: bool = True

    def apply(self, machine: Machine, scene: Scene, index: int, size: float, seed: int) -> Machine:
        """The machine with the effect; the same seed gives the same shape at any size."""
        return self.build(machine, scene, index, size, np.random.default_rng(seed))


def axis(machine: Machine, index: int, **changes: Any) -> Machine:
    """The machine with other extras of one axis."""
    extras = machine.truth.extras
    axes = list(extras.axes or (AxisExtras(),) * len(machine.robot.cylinders))
    axes[index] = replace(axes[index], **changes)
    return with_truth(machine, extras=replace(extras, axes=tuple(axes)))


def with_truth(machine: Machine, **changes: Any) -> Machine:
    """The machine with another truth."""
    return replace(machine, truth=replace(machine.truth, **changes))


def cylinder(machine: Machine, index: int, **changes: Any) -> Machine:
    """The machine with another cylinder."""
    records: list[CylinderTruth] = list(machine.truth.cylinders)
    records[index] = replace(records[index], **changes)
    return with_truth(machine, cylinders=tuple(records))


def valve(machine: Machine, index: int, **changes: Any) -> Machine:
    """The machine with another valve of the cylinder."""
    records: list[ValveTruth] = list(machine.truth.valves)
    name = machine.robot.cylinders[index].name
    at = [v.cylinder for v in machine.robot.valves].index(name)
    records[at] = replace(records[at], **changes)
    return with_truth(machine, valves=tuple(records))


def machine_extras(machine: Machine, **changes: Any) -> Machine:
    """The machine with other extras of the whole."""
    extras = machine.truth.extras
    return with_truth(machine, extras=replace(extras, machine=replace(extras.machine, **changes)))


def sensor_extras(machine: Machine, name: str, values: Mapping[str, float]) -> Machine:
    """The machine with other extras of its instruments."""
    extras = machine.truth.extras
    merged = {**getattr(extras.sensors, name), **values}
    changes: dict[str, Any] = {name: merged}
    sensors = replace(extras.sensors, **changes)
    return with_truth(machine, extras=replace(extras, sensors=sensors))


def sign(random: np.random.Generator) -> float:
    """Plus or minus one."""
    return float(random.choice([-1.0, 1.0]))


def has_lever(machine: Machine, index: int) -> bool:
    """The cylinder turns a joint: its lever changes."""
    return machine.robot.cylinders[index].l1_m != 0.0


def unrecorded(machine: Machine, index: int) -> bool:
    """Supply and tank are not on record."""
    return not machine.lines_recorded
