"""Which rows say something of a law: joints move, edges are told, nothing is extrapolated."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hydro_ident.estimate.scoring.noise import pressure_noise
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.mismatch.rows.material import Material, Place, pressure_of
from hydro_ident.mismatch.rows.rests import moving_rows
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

#: Share of a joint's range by which rows to check on may lie beyond those that were fitted.
_BEYOND = 0.03
#: Share of the usual flow by which an edge's flow may be off. Noise of the deviation s makes the
#: mean root of a drop d smaller by s^2 / (8 d^2), and a pressure that changes by D from sample to
#: sample, taken to be straight there, is off by some D / 8.
_OFF = 0.01


def telling(material: Material, signals: SignalSurvey) -> BoolArray:
    """Rows on which laws can be judged.

    Parameters
    ----------
    material : Material
    signals : SignalSurvey
        Noise of the pressures.

    Returns
    -------
    (N,) bool array
    """
    result = moving_rows(material)
    for place in material.places:
        if material.is_flow(place.channel):
            result[place.rows] &= _told(material, place, signals)
    return result


def _told(material: Material, place: Place, signals: SignalSurvey) -> BoolArray:
    """Windows in which the open edge's flow follows from the pressures that were read."""
    stretch = material.stretches[place.stretch]
    number = material.chamber_index(place.channel)
    chamber, trace = material.chambers[number], stretch.trace
    first = chamber.side == "a"
    pressure = pressure_of(chamber, trace)
    sensor = (signals.p_a if first else signals.p_b)[chamber.index]
    noise = pressure_noise(material.robot, sensor)
    u = trace.valve_signal[:, chamber.index]
    drop = np.abs(np.where((u > 0.0) == first, trace.supply - pressure, pressure - trace.tank))
    # A window may end at a sample whose signal is unknown: which edge is open there nobody knows.
    drop[~np.isfinite(u)] = np.nan
    change = np.abs(np.diff(pressure, prepend=pressure[:1]))
    starts, span = stretch.starts[number], stretch.span
    if not starts.size:
        return np.zeros(0, dtype=np.bool_)
    least = np.maximum(np.fmin.reduce(_over_windows(drop, starts, span), axis=1), 1.0)
    most = _over_windows(change, starts, span).max(axis=1)
    flow = np.fmax.reduce(_over_windows(np.abs(u) * np.sqrt(drop), starts, span), axis=1)
    usual = float(np.sqrt(np.mean(flow**2))) or 1.0
    off = noise**2 / (8.0 * least**2) + most / (16.0 * least)
    return np.asarray(off * flow <= _OFF * usual)


def _over_windows(values: FloatArray, starts: np.ndarray, span: int) -> FloatArray:
    """Samples of every window, (W, span + 1)."""
    return np.asarray(sliding_window_view(values, span + 1)[starts])


def within(material: Material, rows: BoolArray, there: Material) -> BoolArray:
    """Which rows lie where their joint has been in some rows: beyond, a law is extrapolated.

    Parameters
    ----------
    material : Material
    rows : (N,) bool array
        Of it: what was fitted.
    there : Material
        Of the same robot.

    Returns
    -------
    (M,) bool array
        Rows of `there`.
    """
    own, other = material.positions(), there.positions()
    result = np.zeros(there.size, dtype=np.bool_)
    for k, name in enumerate(there.channels):
        if name not in material.channels:
            continue
        known = own[rows & (material.channel == material.channels.index(name))]
        if known.size:
            margin = _BEYOND * float(np.ptp(known))
            inside = (other >= known.min() - margin) & (other <= known.max() + margin)
            result |= inside & (there.channel == k)
    return result


def unfitted(
    there: Material,
    moving: Mapping[str, Collection[int]],
    parked: Mapping[str, Collection[int]] | None = None,
) -> BoolArray:
    """Which rows ask for what a joint's motion alone would have told: it stood still in the fit.

    A force depends on how all joints lie and move: in a recording in which such a joint does, or
    stands still elsewhere, no force is predicted. A chamber's balance knows its own joint only.

    Parameters
    ----------
    there : Material
    moving : mapping of str to collection of int
        By recording, the joints that move there and stood still in all that was fitted.
    parked : mapping of str to collection of int, optional
        Those that stand still there, too, but elsewhere.

    Returns
    -------
    (M,) bool array
        Rows of `there`.
    """
    result = np.zeros(there.size, dtype=np.bool_)
    for number, name in enumerate(there.recordings):
        joints, elsewhere = moving.get(name, ()), (parked or {}).get(name, ())
        for k in range(len(there.channels)) if joints or elsewhere else ():
            if not there.is_flow(k) or there.joint_of(k) in joints:
                result |= (there.recording == number) & (there.channel == k)
    return result
