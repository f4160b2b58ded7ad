"""What the control law answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_control.motion.required_motion import Reference
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Output:
    """One answer of the law. Arrays are (n,), one per joint, but for the voltage.

    Attributes
    ----------
    voltage_v : (m,) array
        Per valve, in the robot's order: saturated, slewed; 0 on a fault.
    valve_signal : array
        Normalised signal u before saturation (eq. 24).
    flow_term : array
        Q_d in m^2/s (eq. 23).
    required_force_n, force_n : array
        Piston force required (eq. 22) and measured, N.
    required_piston_velocity_m_s, piston_velocity_m_s : array
    q_d, qd_d : array
        Desired joint position and velocity, for `/joint_reference`.
    tip_d_m : (3,) array
        Desired tip position, for `/tip_reference`.
    notes : tuple of str
        What was limited or started anew.
    fault : str
        Empty, or why the voltage is 0.
    """

    voltage_v: FloatArray
    valve_signal: FloatArray
    flow_term: FloatArray
    required_force_n: FloatArray
    force_n: FloatArray
    required_piston_velocity_m_s: FloatArray
    piston_velocity_m_s: FloatArray
    q_d: FloatArray
    qd_d: FloatArray
    tip_d_m: FloatArray
    notes: tuple[str, ...] = ()
    fault: str = ""


def stopped(q: FloatArray, reference: Reference, valves: int, fault: str) -> Output:
    """The answer to a fault: 0 V.

    `valves` is their number.
    """
    zero = np.zeros_like(np.asarray(q, dtype=float))
    joint = reference.space == "joint"
    return Output(
        voltage_v=np.zeros(valves),
        valve_signal=zero,
        flow_term=zero,
        required_force_n=zero,
        force_n=zero,
        required_piston_velocity_m_s=zero,
        piston_velocity_m_s=zero,
        q_d=reference.position if joint else np.asarray(q, dtype=float),
        qd_d=zero,
        tip_d_m=np.full(3, np.nan) if joint else reference.position,
        fault=fault,
    )
