"""Kinds, cranes, motions and seeds of the study."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_ident.design.experiment import LIMITS
from hydro_ident.design.limits import fits
from hydro_ident.errors import IdentError
from hydro_ident.study.command import frozen_seed, run
from hydro_ident.study.experiments import work
from hydro_ident.study.generate import kinds
from hydro_ident.study.machines import random_crane
from hydro_model.robot import Robot


def test_kinds_have_their_shares_in_an_order_of_chance() -> None:
    counts = Counter(kinds(3, 750))
    assert sum(counts.values()) == 750
    assert (counts["clean"], counts["outside"]) == (300, 150)
    assert counts["single"] + counts["double"] + counts["triple"] == 300
    assert len(kinds(3, 12)) == 12
    assert kinds(3, 40) == kinds(3, 40)
    assert kinds(3, 40) != kinds(4, 40)


def test_random_cranes_read_back_and_differ(tmp_path: Path) -> None:
    robots = [random_crane(f"c{k}", k, tmp_path / str(k))[1] for k in range(6)]
    assert len({r.cylinders[0].bore_m for r in robots}) == 6
    assert {r.dof for r in robots} <= {1, 2, 3}
    again = random_crane("c0", 0, tmp_path / "again")[1]
    np.testing.assert_array_equal(again.link_inertia, robots[0].link_inertia)
    for robot in robots:
        plain_truth(robot, 1)


def test_work_goes_round_the_same_stations_within_the_limits(crane: Robot) -> None:
    train, check = work(crane, 3)
    assert (len(train.q), len(check.q)) == (30_000, 20_000)
    np.testing.assert_array_equal(work(crane, 3)[0].q, train.q)
    qdd = np.gradient(train.qd, 2e-3, axis=0)
    assert fits(crane, LIMITS, train.q[::10], train.qd[::10], 0.9 * qdd[::10])
    rests = train.q[500:][np.all(train.qd[500:] == 0.0, axis=1)]
    stations, visits = np.unique(np.round(rests, 6), axis=0, return_counts=True)
    assert 3 <= len(stations) <= 7
    # Held for 0.3 to 1.5 s each time: longer in all is more than once.
    assert np.sum(visits > 800) >= 2


def test_seed_from_a_commit() -> None:
    assert frozen_seed("abc1234") == frozen_seed("ABC1234") != frozen_seed("abc1235")
    with pytest.raises(IdentError, match="expected --frozen"):
        frozen_seed("main")


def test_another_plan_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text('{"cases": 4, "seed": 1, "frozen": null}')
    with pytest.raises(IdentError, match="holds a study of 4 cases"):
        run(["--out", str(tmp_path), "--cases", "5", "--seed", "1"])
