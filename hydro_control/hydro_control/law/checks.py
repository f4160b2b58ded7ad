"""Checks of what goes into the control law."""

from __future__ import annotations

import math

import numpy as np

from hydro_control.motion.required_motion import Reference
from hydro_model.robot import FloatArray


def not_finite(
    stamp_s: float,
    q: FloatArray,
    p_a: FloatArray,
    p_b: FloatArray,
    p_s: float,
    p_t: float,
    reference: Reference,
) -> str:
    """What of a law's inputs (as of `ControlLaw.step`) is not finite; empty where all is.

    `stamp_s` is the time of the sample, s.
    """
    # A sum is finite only where every part is; finding out which is for the rare case.
    motion = sum(q.tolist()) + sum(reference.position.tolist()) + sum(reference.velocity.tolist())
    motion += sum(reference.acceleration.tolist())
    oil = sum(p_a.tolist()) + sum(p_b.tolist()) + p_s + p_t
    if math.isfinite(motion + oil + stamp_s):
        return ""
    parts = {
        "joint position": q,
        "pressure of chamber A": p_a,
        "pressure of chamber B": p_b,
        "reference position": reference.position,
        "reference velocity": reference.velocity,
        "reference acceleration": reference.acceleration,
        "stamp, supply or tank pressure": np.array([stamp_s, p_s, p_t]),
    }
    names = [name for name, part in parts.items() if not np.all(np.isfinite(part))]
    found = "; ".join(f"{name} {parts[name].tolist()}" for name in names)
    return f"expected finite numbers, found {found or 'values beyond the range of numbers'}"
