"""What is wrong with a recording's signals: stuck, saturated, out of range, latched.

Findings are plain sentences with numbers; nothing is repaired.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.gaps import longest_gap
from hydro_ident.bag.grid import runs
from hydro_ident.bag.own_rate import interpolation_text, samples_per_reading
from hydro_ident.bag.recording import Recording
from hydro_model.robot import Robot

FloatArray = NDArray[np.float64]

#: A noisy transducer never repeats its reading this long, an encoder not while its valve is open.
STUCK_S = 1.0
_OPEN_SHARE = 0.02
_FULL_SHARE = 0.999
#: Signals may touch a joint limit by an encoder's noise.
_LIMIT_MARGIN = 1e-3


@dataclass(frozen=True, slots=True)
class Finding:
    """One irregularity.

    Attributes
    ----------
    signal : str
        What it is about, e.g. `lift_cylinder/a`.
    kind : str
        `stuck`, `saturated`, `limit`, `range`, `not_finite`, `latched`, `interpolated`, `gap`,
        or `other`: the bag names another robot.
    text : str
        In words, with numbers.
    """

    signal: str
    kind: str
    text: str


def find_irregularities(recording: Recording) -> list[Finding]:
    """Look over a recording's signals.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    list of Finding
        Empty for a healthy recording.
    """
    return [
        *_gaps(recording),
        *_interpolated(recording),
        *_latched(recording),
        *_joints(recording),
        *_pressures(recording),
        *_valves(recording),
    ]


def _gaps(recording: Recording) -> list[Finding]:
    longest = longest_gap(recording.gaps, int(recording.stamp_ns[0]))
    if longest is None:
        return []
    count, missing = len(recording.gaps), sum(gap.missing for gap in recording.gaps)
    text = (
        f"{count} gap{'s' if count > 1 else ''}, {missing} cycles missing; the longest,"
        f" {longest.length_s:.3f} s ({longest.missing} cycles), after {longest.after_s:.3f} s"
    )
    return [Finding("cycles", "gap", text)]


def _interpolated(recording: Recording) -> list[Finding]:
    every = samples_per_reading(recording)
    if every == 1:
        return []
    return [Finding("cycles", "interpolated", interpolation_text(recording, every))]


def _latched(recording: Recording) -> list[Finding]:
    spans = runs(recording.latched)
    if not spans:
        return []
    total_s = float(recording.latched.sum()) * recording.period_s
    first_s = recording.time_s[spans[0][0]]
    text = (
        f"the gate held 0 V against the command for {total_s:.2f} s in {len(spans)} spans,"
        f" first at {first_s:.2f} s"
    )
    return [Finding("valves", "latched", text)]


def _joints(recording: Recording) -> list[Finding]:
    findings = []
    robot = recording.robot
    for i, joint in enumerate(robot.joints):
        q = recording.q[:, i]
        if bool(np.isnan(q).all()):
            continue
        findings += _not_finite(joint.name, q)
        below, above = np.nanmin(q), np.nanmax(q)
        if below < joint.lower - _LIMIT_MARGIN or above > joint.upper + _LIMIT_MARGIN:
            text = (
                f"from {below:.4f} to {above:.4f}, outside its limits"
                f" {joint.lower:.4f} to {joint.upper:.4f}"
            )
            findings.append(Finding(joint.name, "limit", text))
        opened = _valve_open(recording, robot, joint.name)
        if opened is not None:
            findings += _stuck(recording, joint.name, q, opened)
    return findings


def _valve_open(recording: Recording, robot: Robot, joint: str) -> NDArray[np.bool_] | None:
    cylinders = {c.name for c in robot.cylinders if c.joint == joint}
    for k, valve in enumerate(robot.valves):
        if valve.cylinder in cylinders and recording.valve_v is not None:
            share = np.abs(np.nan_to_num(recording.valve_v[:, k])) / valve.rated_voltage_v
            return np.asarray(share > _OPEN_SHARE, dtype=np.bool_)
    return None


def _pressures(recording: Recording) -> list[Finding]:
    findings = []
    atmosphere_pa = recording.robot.atmospheric_pressure_pa
    full_pa = recording.robot.sensors.pressure_range_pa
    # Dead transducers' columns are NaN; what they read says why.
    dead = {k: np.full(len(recording), v) for k, v in recording.dead.items() if "/" in k}
    for name, p in (pressure_columns(recording) | dead).items():
        findings += _not_finite(name, p)
        findings += _stuck(recording, name, p)
        full = float(np.mean(p >= _FULL_SHARE * full_pa))
        if full:
            text = f"{full:.1%} of the time at the end of its range ({full_pa / 1e5:.0f} bar)"
            findings.append(Finding(name, "saturated", text))
        void = float(np.mean(p < -atmosphere_pa))
        if void:
            low_bar = (float(np.nanmin(p)) + atmosphere_pa) / 1e5
            text = (
                f"{void:.1%} of the time below vacuum (down to {low_bar:.2f} bar absolute):"
                " gauge recorded as absolute, or a zero that is off"
            )
            findings.append(Finding(name, "range", text))
    return findings


def pressure_columns(recording: Recording) -> dict[str, FloatArray]:
    """Every recorded pressure by its name in `/chamber_pressures`, Pa gauge, (N,) each.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    dict of str to array
    """
    columns: dict[str, FloatArray] = {}
    for i, cylinder in enumerate(recording.robot.cylinders):
        for side, chambers in (("a", recording.p_a), ("b", recording.p_b)):
            if chambers is not None and not bool(np.isnan(chambers[:, i]).all()):
                columns[f"{cylinder.name}/{side}"] = chambers[:, i]
    for name, values in (("supply", recording.supply), ("tank", recording.tank)):
        if values is not None:
            columns[name] = values
    return columns


def _valves(recording: Recording) -> list[Finding]:
    findings = []
    if recording.valve_v is None:
        return []
    for k, valve in enumerate(recording.robot.valves):
        share = np.abs(recording.valve_v[:, k]) / valve.rated_voltage_v
        full = float(np.mean(share >= _FULL_SHARE))
        if full:
            text = f"{full:.1%} of the time at {valve.rated_voltage_v:g} V"
            findings.append(Finding(valve.name, "saturated", text))
    return findings


def _not_finite(name: str, values: FloatArray) -> list[Finding]:
    count = int(np.sum(~np.isfinite(values)))
    return [Finding(name, "not_finite", f"{count} samples are not finite")] if count else []


def _stuck(
    recording: Recording,
    name: str,
    values: FloatArray,
    driven: NDArray[np.bool_] | None = None,
) -> list[Finding]:
    """Longest stretch of bit-identical readings, of which most were `driven` where given."""
    same = np.concatenate(([False], np.diff(values) == 0.0))
    shortest = STUCK_S / recording.period_s
    spans = [
        (begin, end)
        for begin, end in runs(same)
        if end - begin >= shortest and (driven is None or float(driven[begin:end].mean()) > 0.5)
    ]
    if not spans:
        return []
    begin, end = max(spans, key=lambda span: span[1] - span[0])
    when = "" if driven is None else " although its valve was open"
    text = (
        f"unchanged for {(end - begin) * recording.period_s:.2f} s"
        f" from {recording.time_s[begin]:.2f} s on{when}"
    )
    return [Finding(name, "stuck", text)]
