"""The flow of all valves at a rail, on the rows of a channel."""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot import FloatArray, Robot


def line_flow(predictor: Predictor, model: Model, channel: int, *, on_tank: bool) -> FloatArray:
    """What all valves draw from the supply, or return to the tank, at a channel's rows.

    Commands are taken as they were recorded, some milliseconds early: this tells a range.

    Parameters
    ----------
    predictor : Predictor
    model : Model
        Its edges, valve signals and rails.
    channel : int
        Whose rows.
    on_tank : bool
        Returned to the tank.

    Returns
    -------
    (N,) array
        m^3/s; NaN on other channels' rows.
    """
    material, signals = predictor.material, predictor.signals
    result = np.full(material.size, np.nan)
    for place in material.of_channels([channel]):
        stretch = signals.readings.stretches(model)[place.stretch]
        flow = _flow(model.robot, signals.shaped(model, stretch), on_tank)
        result[place.rows] = material.on_rows(stretch, channel, flow)
    return result


def _flow(robot: Robot, trace: Trace, on_tank: bool) -> FloatArray:
    """Sum over the valves; what is not known of one draws nothing, as rails have it."""
    at = {cylinder.name: i for i, cylinder in enumerate(robot.cylinders)}
    total = np.zeros(trace.samples)
    for valve in robot.valves:
        i = at[valve.cylinder]
        u, chambers = trace.valve_signal[:, i], (trace.p_a[:, i], trace.p_b[:, i])
        into_a, into_b = edge_flows(valve, u, *chambers, trace.supply, trace.tank)
        # One chamber is on the supply, the other one on the tank.
        own = np.where(u > 0.0, -into_b, -into_a) if on_tank else np.where(u > 0.0, into_a, into_b)
        total += np.where(np.isfinite(own), own, 0.0)
    return total
