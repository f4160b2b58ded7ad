"""Time and valve voltages of a recording that look like another unit than s and V."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.running import Spans
from hydro_ident.logs.plausible import rate_warning
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import Robot

#: Signals below this share of the rated one move no arm: they are within a valve's overlap and
#: its null bias, by which a load creeps.
_CLOSED = 0.005
#: A joint that goes through this share of its range was driven, and did not creep.
_DRIVEN = 0.05


def mistaken_rates(recordings: Iterable[Recording]) -> list[str]:
    """Recordings whose rate is none of their machine's.

    Parameters
    ----------
    recordings : iterable of Recording

    Returns
    -------
    list of str
        A sentence per recording.
    """
    said = [(r.path.name, rate_warning(r.robot, r.period_s)) for r in recordings]
    return [f"{name}: cycles: {text}" for name, text in said if text]


def mistaken_voltages(robot: Robot, spans: Mapping[str, Spans]) -> str:
    """That an arm was moved by valves that were as good as closed; empty where it was not.

    Voltages that are 0 throughout are in no unit: somebody else moved that arm.

    Parameters
    ----------
    robot : Robot
    spans : mapping of str to Spans
        By field of the recording.

    Returns
    -------
    str
    """
    if not {"q", "valve_v"} <= spans.keys():
        return ""
    volts = np.maximum(np.abs(spans["valve_v"].low), np.abs(spans["valve_v"].high))
    shares = volts / np.array([valve.rated_voltage_v for valve in robot.valves])
    if not np.isfinite(shares).all() or not 0.0 < shares.max() < _CLOSED:
        return ""
    width = limits(robot) @ np.array([-1.0, 1.0])
    moved = (spans["q"].high - spans["q"].low) > _DRIVEN * width
    driven = {robot.cylinder(valve.cylinder).joint for valve in robot.valves}
    names = [n for n, far in zip(robot.joint_names, moved, strict=True) if far and n in driven]
    if not names:
        return ""
    return (
        f"at most {1e3 * float(volts.max()):.3g} mV although {', '.join(names)} moved: is the unit"
        " V, as the contract has it?"
    )
