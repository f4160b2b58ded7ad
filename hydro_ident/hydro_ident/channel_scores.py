"""Scores of the force and flow channels: the given robot against the identified one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.estimate.chambers import (
    INVERSE_BULK,
    Chamber,
    chamber_rows,
    chambers_of,
    column_names,
)
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.hydraulics import HydraulicFit
from hydro_ident.estimate.inertial import ForceModel, InertialFit, force_rows, measured_force
from hydro_ident.estimate.listed_effects import NULL_BIAS, OVER_BULK, ListedEffects
from hydro_ident.estimate.noise import flow_noise, force_noise
from hydro_ident.estimate.scores import ChannelScore, HoldOut, score
from hydro_ident.estimate.traces import Trace
from hydro_ident.parameters import listed_value
from hydro_model.robot import FloatArray, Robot


def force_scores(
    fit: InertialFit | None,
    robot: Robot,
    traces: Sequence[Trace],
    split: HoldOut,
    filters: FilterSettings,
) -> list[ChannelScore]:
    """Scores of the force channels on rows that took no part in the fit.

    Parameters
    ----------
    fit : InertialFit or None
    robot : Robot
        The given robot, for the predictions before.
    traces : sequence of Trace
    split : HoldOut
    filters : FilterSettings

    Returns
    -------
    list of ChannelScore
        Channels that were measured.
    """
    if fit is None:
        return []
    model = fit.model
    before = _given_theta(model, robot)
    still = fit.still if split.every else ()
    pieces = []
    for trace in traces:
        rows = force_rows(model, trace, filters, still)
        if rows is not None:
            chosen = split.held_out(rows)
            pieces.append((chosen, chosen.x @ before, chosen.x @ fit.fit.theta))
    measured = [t for t in traces if np.isfinite(t.q).all()]
    floors = force_noise(model, measured, filters) if pieces else np.zeros(robot.dof)
    units = dict(zip(model.channels, model.units, strict=True))
    scores = [
        score(name, units[name], pieces, column, float(floors[column]))
        for column, name in enumerate(model.channels)
        if any(np.isfinite(measured_force(model, t)[:, column]).any() for t in measured)
    ]
    return [s for s in scores if s is not None]


def _given_theta(model: ForceModel, robot: Robot) -> FloatArray:
    base = model.base.combination @ robot.link_inertia.ravel()
    friction = [cylinder.viscous_friction for cylinder in robot.cylinders]
    listed = [listed_value(robot, name) for name in model.effect_names]
    return np.array([*base, *friction, *listed])


def flow_scores(
    fit: HydraulicFit | None,
    robot: Robot,
    effects: tuple[ListedEffects, ListedEffects],
    traces: Sequence[Trace],
    split: HoldOut,
) -> list[ChannelScore]:
    """Scores of the flow channels on windows that took no part in the fit.

    Parameters
    ----------
    fit : HydraulicFit or None
    robot : Robot
        The given robot, for the predictions before.
    effects : tuple of ListedEffects
        As given, and as fitted.
    traces : sequence of Trace
        As recorded, without signal laws.
    split : HoldOut

    Returns
    -------
    list of ChannelScore
        Channels that were measured.
    """
    if fit is None:
        return []
    found = {c.cylinder: c for c in fit.cylinders}
    scores = []
    for chamber in chambers_of(robot):
        result = found.get(chamber.cylinder.name)
        if result is None or chamber.side not in [c.chamber.side for c in result.chambers]:
            continue
        pieces = []
        for trace in traces:
            rows, names = [], column_names(chamber)
            for laws, delay in zip(effects, (robot.command_delay_s, fit.delay_s), strict=True):
                shaped = laws.with_signal_laws(trace)
                listed, extra = laws.chamber_columns(chamber, shaped)
                names = column_names(chamber, listed)
                built = chamber_rows(chamber, shaped, delay, fit.windows, extra)
                rows.append(split.held_out(built))
            given, fitted = rows
            theta = np.array([result.value(name)[0] for name in names])
            # The same windows at either delay: only the flow columns differ.
            before = given.x @ _given_chamber(robot, chamber, names)
            pieces.append((fitted, before, fitted.x @ theta))
        if not any(rows.time_s.size for rows, _, _ in pieces):
            continue
        inverse_bulk = result.value(INVERSE_BULK)[0]
        floor = flow_noise(robot, chamber, traces, fit.windows, inverse_bulk)
        scores.append(score(chamber.channel, "m^3/s", pieces, 0, floor))
    return [s for s in scores if s is not None]


def _given_chamber(robot: Robot, chamber: Chamber, names: Sequence[str]) -> FloatArray:
    inverse = 1.0 / chamber.cylinder.bulk_modulus_pa
    values = []
    for name in names:
        if name == INVERSE_BULK:
            values.append(inverse)
        elif name in chamber.edges:
            values.append(float(getattr(chamber.valve, name)))
        elif name == NULL_BIAS:
            values.append(0.0)  # The signal law of the trace holds it already.
        else:
            plain = name.removesuffix(OVER_BULK)
            value = listed_value(robot, f"{chamber.cylinder.name}.{plain}")
            values.append(value * inverse if name != plain else value)
    return np.array(values)
