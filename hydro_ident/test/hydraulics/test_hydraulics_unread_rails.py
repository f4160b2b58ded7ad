"""Chambers beside rails that nobody read, and what comes to them from outside of the noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings, chambers_of
from hydro_ident.estimate.flows.cylinder_fit import combined
from hydro_ident.estimate.flows.delay import fit_delay
from hydro_ident.estimate.flows.flow_moments import FlowGatherer
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.estimate.flows.unread_rails import (
    RailConstant,
    _between_recordings,
    _Told,
    settled_constants,
)
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.robot import Robot

SUPPLY, TANK, STILL, DELAY = 18.0e6, 0.8e6, 9.0e6, 0.001


def _still_chamber(robot: Robot, bench: Any, noise_pa: float) -> Trace:
    """A piston that chamber A moves at one pressure, B's not recorded."""
    time = np.arange(0.0, 12.0, bench.H)
    u = bench.signal(robot, time)
    edge = np.where(
        u > 0.0,
        bench.EDGES["c_pa"] * np.sqrt(SUPPLY - STILL),
        bench.EDGES["c_at"] * np.sqrt(STILL - TANK),
    )
    flow = u * edge
    # Half of an interval later: the flow of the sample before, then its own.
    share = DELAY / bench.H
    swept = np.append(flow[0], flow[:-2]) * share + flow[:-1] * (1.0 - share)
    stroke = 0.3 + np.append(0.0, np.cumsum(swept)) * bench.H / robot.cylinders[0].area_a_m2
    p_a = STILL + noise_pa * np.random.default_rng(0).normal(size=time.size)
    trace = bench.trace(robot, u, time, p_a, np.full(time.size, np.nan))
    trace.stroke[:, 0] = stroke
    return trace


@pytest.mark.parametrize("noise_pa", [0.0, 1.0e3])
def test_a_pressure_that_stands_still_tells_no_rail(
    robot: Robot, bench: Any, noise_pa: float
) -> None:
    given = replace(robot, supply_pressure_pa=SUPPLY, tank_pressure_pa=TANK)
    fit = fit_hydraulics(given, [_still_chamber(robot, bench, noise_pa)])
    assert fit is not None
    for rail in fit.rails:
        assert not rail.told
        assert rail.std_pa == np.inf
        assert rail.error_pa == rail.usual_pa
    (lift,) = fit.cylinders
    assert lift.rejected == ""
    for name in ("c_pa", "c_at"):
        assert lift.value(name)[0] == pytest.approx(bench.EDGES[name], rel=1e-4)


def test_causes_from_outside_do_not_make_an_edge_unknown(robot: Robot, bench: Any) -> None:
    """A rail far off widens intervals; what the data tell is of their noise."""
    gathered = FlowGatherer(robot, "run", WindowSettings())
    gathered.add(bench.run(robot))
    found = fit_delay(robot, [gathered])
    assert found is not None
    pairs = list(zip(chambers_of(robot), found.chambers.values(), strict=False))
    far = RailConstant("supply", SUPPLY, 0.4 * SUPPLY, 0.0, 0.1 * SUPPLY)
    chambers = [(c, replace(one, carried={"supply": one.fit.theta / SUPPLY})) for c, one in pairs]
    lift, alone = combined(chambers, [far]), combined(pairs)
    assert alone.rejected == lift.rejected == ""
    assert all(lift.identifiable)
    for name in bench.EDGES:
        value, std = lift.value(name)
        assert std > 0.35 * value
        assert alone.value(name) == (value, pytest.approx(alone.value(name)[1]))
        assert alone.value(name)[1] < 0.01 * value


def test_steps_that_do_not_end_are_a_deviation() -> None:
    found = (RailConstant("supply", SUPPLY, 2.0e6, 1.0e3, 0.1 * SUPPLY),)
    (last,) = settled_constants(
        found, lambda at: [replace(found[0], off_pa=-2.0 * at["supply"] + 1.0e6)]
    )
    assert last.std_pa > 1.0e6
    assert not last.told


def test_a_constant_that_is_off_by_next_to_nothing_is_not_told() -> None:
    """10.03 bar where the file says 10, however sure."""
    assert not RailConstant("tank", 1.0e6, 3.0e3, 1.0e2, 1.0e6).told
    assert RailConstant("tank", 1.0e6, 3.0e5, 1.0e2, 1.0e6).told
    assert not RailConstant("supply", 1.9e7, 1.5e5, 1.0e2, 1.9e6).told


def test_what_recordings_differ_by_beyond_their_noise_is_a_deviation() -> None:
    def told(high_pa: float) -> _Told:
        own = {"a": (high_pa, 1.0e8), "b": (-high_pa, 1.0e8)}
        return _Told((0.0, 1.0e8), own, frozenset(own))

    assert _between_recordings([told(1.0e6)]) == pytest.approx(np.sqrt(2.0) * 1.0e6, rel=1e-3)
    assert _between_recordings([told(5.0e3)]) == 0.0
