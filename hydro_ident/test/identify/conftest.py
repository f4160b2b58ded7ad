"""A simulated run of a crane unlike its datasheet, and what was identified from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.identification import Identification, identify
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot


def _true_robot(effects: tuple[EffectSpec, ...] = ()) -> Robot:
    robot = load_robot("xs031")
    inertia = robot.link_inertia.copy()
    inertia[0] *= 0.9
    inertia[1] *= 1.12
    friction, bulk = (3.2e4, 4.1e4), (8.2e8, 7.4e8)
    edges = ((7.9e-7, 9.3e-7, 8.1e-7, 9.6e-7), (9.4e-7, 7.8e-7, 9.9e-7, 8.4e-7))
    return replace(
        robot,
        link_inertia=inertia,
        cylinders=tuple(
            replace(c, viscous_friction=b, bulk_modulus_pa=k)
            for c, b, k in zip(robot.cylinders, friction, bulk, strict=True)
        ),
        valves=tuple(
            replace(v, c_pa=a, c_at=b, c_pb=c, c_bt=d)
            for v, (a, b, c, d) in zip(robot.valves, edges, strict=True)
        ),
        command_delay_s=0.0013,
        effects=effects,
    )


@pytest.fixture(scope="session")
def driven(make_run: tuple) -> Callable[..., Any]:
    """`driven(seconds, effects)`: a run of that crane under them, seen without noise."""
    _, simulated_run = make_run

    def run(seconds: float, effects: tuple[EffectSpec, ...] = ()) -> Any:
        return simulated_run(_true_robot(effects), seconds, noisy=False)

    return run


@pytest.fixture(scope="session")
def clean(driven: Callable[..., Any]) -> Any:
    return driven(18.0)


@pytest.fixture(scope="session")
def found(clean: Any) -> Identification:
    return identify(load_robot("xs031"), [clean.recording()])


@pytest.fixture
def bag(clean: Any, write_bag: Callable[..., Path]) -> Path:
    return write_bag(clean.columns(), name="excitation")


@pytest.fixture(scope="session")
def with_outliers() -> Callable[..., Recording]:
    """Makes pressures and angles of a recording spike, and pressures drop out now and then.

    `share` of the samples of every sensor spike: pressures by 2 MPa, angles by 0.02 rad. In each
    of the `dropouts`, stretches of 50 ms, a chamber's pressure reads 0 Pa absolute.
    """

    def make(recording: Recording, seed: int, share: float, dropouts: int) -> Recording:
        rng = np.random.default_rng(seed)
        columns = {}
        for name, size in (("q", 0.02), ("p_a", 2.0e6), ("p_b", 2.0e6)):
            values = getattr(recording, name).copy()
            hit = rng.random(values.shape) < share
            columns[name] = values + hit * size * rng.choice((0.5, 1.0, -1.5), values.shape)
        for _ in range(dropouts):
            name, column = rng.choice(["p_a", "p_b"]), rng.integers(columns["p_a"].shape[1])
            begin = int(rng.integers(500, len(recording) - 500))
            columns[name][begin : begin + 25, column] = -recording.robot.atmospheric_pressure_pa
        return replace(recording, **columns)

    return make
