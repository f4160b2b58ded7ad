"""Checks of what goes into the control law, and of what comes out."""

from __future__ import annotations

import math
from collections.abc import Mapping

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
    ahead: Reference | None = None,
) -> str:
    """What of a law's inputs (as of `ControlLaw.step`) is not finite; empty where all is.

    `stamp_s` is the time of the sample, s; `ahead` is None where the law does not look ahead.
    """
    # A sum is finite only where every part is; finding out which is for the rare case.
    motion = sum(q.tolist()) + _sum(reference)
    if ahead is not None:
        motion += _sum(ahead)
    oil = sum(p_a.tolist()) + sum(p_b.tolist()) + p_s + p_t
    if math.isfinite(motion + oil + stamp_s):
        return ""
    parts = {
        "joint position": q,
        "pressure of chamber A": p_a,
        "pressure of chamber B": p_b,
        **_parts(reference, ""),
        "stamp, supply or tank pressure": np.array([stamp_s, p_s, p_t]),
    }
    if ahead is not None:
        parts |= _parts(ahead, " looked ahead to")
    return _named(parts)


def not_finite_answer(flow_term: FloatArray, signal: FloatArray, voltage_v: FloatArray) -> str:
    """What of `flow_term`, `signal` and `voltage_v` is not finite; empty where all is.

    They are those of a law's answer, as of `hydro_control.law.output.Output`.
    A valve that is kept shut has a signal of 0 whatever its flow term is; what the next sample
    starts from, such as the rate of the required force, goes into the flow term.
    """
    total = sum(flow_term.tolist()) + sum(signal.tolist()) + sum(voltage_v.tolist())
    if math.isfinite(total):
        return ""
    return _named({"flow term": flow_term, "valve signal": signal, "voltage": voltage_v})


def _sum(reference: Reference) -> float:
    position, velocity = sum(reference.position.tolist()), sum(reference.velocity.tolist())
    return float(position + velocity + sum(reference.acceleration.tolist()))


def _parts(reference: Reference, which: str) -> dict[str, FloatArray]:
    return {
        f"reference position{which}": reference.position,
        f"reference velocity{which}": reference.velocity,
        f"reference acceleration{which}": reference.acceleration,
    }


def _named(parts: Mapping[str, FloatArray]) -> str:
    names = [name for name, part in parts.items() if not np.all(np.isfinite(part))]
    found = "; ".join(f"{name} {parts[name].tolist()}" for name in names)
    return f"expected finite numbers, found {found or 'values beyond the range of numbers'}"
