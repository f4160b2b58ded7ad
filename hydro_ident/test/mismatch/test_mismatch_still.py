"""A joint that is locked while a base is fitted and moves in what it is verified on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.training import start_model
from hydro_ident.mismatch.rows.rests import motions_in, motions_of, moving_rows
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import resolve
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import EffectSpec

JOINT = 1


def _locked(run: Any, begin: int = 0, end: int | None = None) -> Any:
    """The run with the tilt joint locked where it is at the beginning, as its encoder sees it."""
    at, q, voltage = slice(begin, end), run.q.copy(), run.voltage.copy()
    noise = np.random.default_rng(4).normal(0.0, 3e-6, q[at, JOINT].shape)
    q[at, JOINT] = q[begin, JOINT] + noise
    voltage[at, JOINT] = 0.0
    return replace(run, q=q, voltage=voltage)


@pytest.fixture(scope="module")
def half(crane_run: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    """Fitted with the tilt joint locked; verified on a run with it locked, and on a free one."""
    return lay_out(_locked(crane_run), [_locked(crane_run), crane_run])


def test_a_joint_is_held_where_it_stands_still_alone(half: Residuals, crane_run: Any) -> None:
    trained = half.training.predictor.material.stretches
    locked, free = half.check.predictor.material.stretches
    for stretch in (*trained, locked):
        assert stretch.moved is not None
        assert np.ptp(stretch.moved.q[:, JOINT]) < 1e-9
    assert free.moved is not None
    recorded = crane_run.q[:, JOINT]
    # Behind the filters, which leave the motion as it is.
    assert np.abs(free.moved.q[:, JOINT] - recorded)[50:-50].max() < 0.01 * np.ptp(recorded)
    assert np.ptp(free.trace.stroke[:, JOINT]) > 0.9 * np.ptp(
        stroke(half.robot.cylinders[JOINT], recorded)
    )


def test_rows_that_the_base_cannot_predict_are_not_verified_on(half: Residuals) -> None:
    material, check = half.check.predictor.material, half.check
    free = material.recording == material.recordings.index("check1")
    for k, name in enumerate(material.channels):
        own = material.channel == k
        # Of a mass balance its own joint alone matters; of a force all of them do.
        kept = material.is_flow(k) and name.startswith("lift")
        assert bool((check.mask & own & free).any()) == kept, name
        assert check.beyond is not None
        if not kept:
            assert not (check.beyond & own & free).any()
    lift = material.channel == material.channels.index("lift/force")
    assert (check.mask & lift & ~free).any()
    (note,) = [n for n in half.notes if "stood still" in n]
    assert note.startswith("check1: tilt moves, which stood still in all that was fitted")


def test_a_joint_that_moves_everywhere_is_told_nothing_of(
    crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    work = lay_out(crane_run, [_locked(crane_run)])
    assert not any("stood still" in n for n in work.notes)
    stretch = work.check.predictor.material.stretches[0]
    assert stretch.moved is not None
    assert np.ptp(stretch.moved.q[:, JOINT]) > 0.0


@pytest.mark.thorough
def test_a_joint_that_never_moves_moves_no_number_of_its_own(
    crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    """Behind filters a constant is off by rounding, and columns are scaled before they count."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = crane_run.q.copy()
        q[:, JOINT] = rng.uniform(-2.4, -0.4)
        locked = replace(crane_run, q=q, voltage=crane_run.voltage * [1.0, 0.0])
        work = lay_out(locked, [locked])
        (stretch,) = work.training.predictor.material.stretches
        assert stretch.moved is not None
        assert not stretch.moved.qd[:, JOINT].any()
        assert not stretch.moved.qdd[:, JOINT].any()
        given = start_model(work.robot, work.training.predictor)
        names = list(work.training.predictor.material.forces.names)
        at = names.index("tilt_cylinder.viscous_friction")
        assert work.base.model.theta[at] == given.theta[at]
        assert np.abs(work.base.model.theta).max() < 1e3 * np.abs(given.theta).max()


def test_a_joint_that_never_moves_rests_throughout(
    crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    q = crane_run.q.copy()
    q[:, JOINT] = -1.3
    locked = replace(crane_run, q=q, voltage=crane_run.voltage * [1.0, 0.0])
    material = lay_out(locked, [locked]).training.predictor.material
    moving = moving_rows(material)
    own = {name: material.channel == k for k, name in enumerate(material.channels)}
    assert not moving[own["tilt/force"]].any()
    assert moving[own["lift/force"]].mean() > 0.5
    assert motions_in(material) > 0
    assert motions_of(material, JOINT) == 0


def test_a_joint_whose_neighbour_is_not_read_still_moves(
    make_run: tuple[Callable[..., Any], Callable[..., Any]],
    crane_run: Any,
    predictor_of: Callable[..., Any],
) -> None:
    """Without the outer angle no force is known, but what the inner joint does is."""
    given = crane_run.recording()
    q = given.q.copy()
    q[:, JOINT] = np.nan
    true_crane, _ = make_run
    whole = predictor_of(true_crane(), given).material
    part = predictor_of(true_crane(), replace(given, q=q)).material
    assert motions_of(part, 0) == motions_of(whole, 0) == motions_in(part) > 0
    assert motions_of(part, JOINT) == 0
    at = part.channel == part.channels.index("lift/flow_a")
    there = whole.channel == whole.channels.index("lift/flow_a")
    np.testing.assert_array_equal(moving_rows(part)[at], moving_rows(whole)[there])


@pytest.mark.parametrize("joint", ["lift", "tilt"])
def test_an_encoder_that_is_corrected_sets_no_resting_joint_in_motion(
    half: Residuals, joint: str
) -> None:
    """What dithers about a rest is held there: next to no correction is next to no force."""
    predictor = half.training.predictor
    tiny = EffectSpec("encoder_offset", joint, {"offset": 1e-12})
    (one,) = resolve(replace(half.robot, effects=(tiny,)))
    model = replace(half.base.model, terms=())
    (stretch,) = predictor.signals.readings.corrected([one])
    assert stretch.moved is not None
    assert not stretch.moved.qd[:, JOINT].any()
    # The encoder shows what it has shown: only its motion is that of the rest.
    assert np.ptp(stretch.trace.q[:, JOINT]) > 1e-6
    added = predictor.contribution(model, one)
    forces = [k for k, n in enumerate(predictor.material.channels) if n.endswith("/force")]
    assert np.abs(added[np.isin(predictor.material.channel, forces)]).max() < 1e-3
    large = replace(one, parameters=1e9 * one.parameters)
    assert np.abs(predictor.contribution(model, large)).max() > 1.0
