"""Rig core and controller core in one process: what the demo runs over CAN and DDS, offline.

The rig steps a cycle on each answer, as in lockstep; nothing is lost, late or checked by the
gate. For choosing gains and for studies over many plants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.law.law import Output
from hydro_hw_bridge.rig.core import RigCore
from hydro_ident.errors import IdentError
from hydro_model.robot import FloatArray

_SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Run:
    """One closed-loop run on the grid of the rig's cycles.

    Attributes
    ----------
    time_s : (N,) array
    tip_m, tip_reference_m : (N, 3) array
        True tip and desired tip at the same sample.
    q : (N, n) array
        True joint positions.
    voltage_v : (N, m) array
    force_n, required_force_n : (N, n) array
        Piston forces measured and required.
    estimates : (N, k) array
        What the controller adapts, by `Adaptation.names`; k = 0 where it adapts nothing.
    q_read : (N, n) array
        Joint positions as the encoders give them.
    pressure_read : (N, 2 m + 2) array
        Gauge pressures as the transducers give them, by `Robot.pressure_names`.
    q_reference : (N, n) array
        Desired joint positions.
    """

    time_s: FloatArray
    tip_m: FloatArray
    tip_reference_m: FloatArray
    q: FloatArray
    voltage_v: FloatArray
    force_n: FloatArray
    required_force_n: FloatArray
    estimates: FloatArray
    q_read: FloatArray
    pressure_read: FloatArray
    q_reference: FloatArray


def run_closed_loop(rig: RigCore, controller: ControllerCore, duration_s: float) -> Run:
    """Drive the rig by the controller for a while.

    Parameters
    ----------
    rig : RigCore
        At its initial pose.
    controller : ControllerCore
        With the path to play.
    duration_s : float

    Returns
    -------
    Run
    """
    cycles = round(duration_s / rig.cycle_s)
    rows = []
    for _ in range(cycles):
        output = _answer(rig, controller)
        plant, read = rig.plant, rig.readings().measurement
        rows.append(
            (
                plant.tip()[:3],
                output.tip_d_m,
                plant.q.copy(),
                output.voltage_v,
                output.force_n,
                output.required_force_n,
                _estimates(controller),
                read.positions,
                read.pressures_pa,
                output.q_d,
            )
        )
        rig.actuate(output.voltage_v.tolist())
    columns = [np.array(column, dtype=np.float64) for column in zip(*rows, strict=True)]
    time_s = np.arange(cycles, dtype=np.float64) * rig.cycle_s
    return Run(time_s, *columns)


def _estimates(controller: ControllerCore) -> FloatArray:
    adaptation = controller.law.adaptation
    return np.zeros(0) if adaptation is None else adaptation.estimates


def _answer(rig: RigCore, controller: ControllerCore) -> Output:
    robot, measurement = rig.robot, rig.readings().measurement
    absolute = np.array(measurement.pressures_pa) + robot.atmospheric_pressure_pa
    chambers = absolute[: 2 * len(robot.cylinders)].reshape(-1, 2)
    stamp = round(rig.cycles * rig.cycle_s * _SECOND_NS)
    q = np.array(measurement.positions)
    sample = Sample(stamp, q, chambers[:, 0], chambers[:, 1], absolute[-2], absolute[-1])
    answer = controller.answer(sample)
    if answer is None:
        raise IdentError(f"no answer at {stamp} ns: expected a controller core not used before")
    return answer.output
