"""Fits on several cores: the same numbers, and what happens where a process does not come back."""

from __future__ import annotations

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.errors import IdentError
from hydro_ident.mismatch.answer.confirmation import searched
from hydro_ident.mismatch.fitting.side_by_side import cores, side_by_side
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot


def test_results_come_in_the_order_of_the_things_from_other_processes() -> None:
    held = np.arange(3.0)
    found = side_by_side(lambda k: (float(held[k]), os.getpid()), [2, 0, 1], 3)
    assert [value for value, _ in found] == [2.0, 0.0, 1.0]
    assert os.getpid() not in {pid for _, pid in found}
    assert side_by_side(lambda _: os.getpid(), [0, 1], 1) == [os.getpid()] * 2
    assert side_by_side(lambda _: os.getpid(), [0], 4) == [os.getpid()]
    assert side_by_side(lambda _: 0, [], 4) == []


def test_effects_of_results_are_those_of_the_catalogue() -> None:
    forms = [form for effect in CATALOGUE.values() for form in effect.forms]
    back = side_by_side(lambda some: tuple(some), [forms[:9], forms[9:]], 2)
    assert all(a is b for a, b in zip(forms, (*back[0], *back[1]), strict=True))


def test_ranges_that_a_recording_gives_come_back_with_their_effect() -> None:
    """Where something may stand, or when it began, the recording says (`places.py`)."""
    known = [form for effect in CATALOGUE.values() for form in effect.forms if form.parameters]
    own = [
        replace(one, parameters=tuple(replace(spec, lower=-7.0) for spec in one.parameters))
        for one in known
    ]
    back = side_by_side(lambda some: tuple(some), [own[:9], own[9:]], 2)
    assert [*back[0], *back[1]] == own


def test_errors_are_raised_here_and_a_process_that_dies_is_said() -> None:
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 // k, [1, 0], 2)
    with pytest.raises(IdentError, match=r"one of 2 processes ended early, .* --processes 1"):
        side_by_side(lambda k: os._exit(1), [1, 2], 2)


def test_an_error_does_not_wait_for_what_others_are_at() -> None:
    began = time.monotonic()
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: time.sleep(600.0) if k else 1 // k, [1, 0], 2)
    assert time.monotonic() - began < 60.0


def test_a_process_that_cannot_be_had_is_said_and_leaves_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second fork fails, as where memory is short: what waits for work already is ended."""
    forks, fork = [0], os.fork

    def failing() -> int:
        forks[0] += 1
        if forks[0] == 2:
            raise OSError(errno.ENOMEM, "Cannot allocate memory")
        return fork()

    before = set(multiprocessing.active_children())
    monkeypatch.setattr(os, "fork", failing)
    with pytest.raises(IdentError, match=r"a further process cannot be had .* --processes 1"):
        side_by_side(lambda k: k, [1, 2], 2)
    for one in set(multiprocessing.active_children()) - before:
        one.join(20.0)
    assert set(multiprocessing.active_children()) == before


SLEEPING = """
import os, time
from hydro_ident.mismatch.fitting.side_by_side import side_by_side

def sleep(_):
    os.write(1, b"%d\\n" % os.getpid())
    time.sleep(600)

side_by_side(sleep, [0, 1], 2)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_process_outlives_the_one_that_asked(number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SLEEPING], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as parent:
        assert parent.stdout is not None
        children = [int(parent.stdout.readline()) for _ in range(2)]
        # Ctrl-C at a terminal reaches the children as well; a kill reaches the parent alone.
        for pid in (*children, parent.pid) if number is signal.SIGINT else (parent.pid,):
            os.kill(pid, number)
        assert parent.wait(20.0) != 0
    until = time.monotonic() + 20.0
    while any(Path(f"/proc/{pid}").exists() for pid in children):
        assert time.monotonic() < until, "a forked process goes on"
        time.sleep(0.05)


def test_processes_are_at_least_one_and_no_more_than_cores() -> None:
    assert 1 <= cores() <= min(4, len(os.sched_getaffinity(0)))
    with pytest.raises(IdentError, match="at least 1 process, found 0"):
        DiagnosisSettings(processes=0)


def test_fits_of_a_contest_are_the_same_to_the_last_bit(rubbing: Residuals) -> None:
    names = ("coulomb_friction", "stribeck_friction", "asymmetric_friction")
    usual = [
        EffectSpec(n, "lift_cylinder", {p.name: p.typical for p in CATALOGUE[n].parameters})
        for n in names
    ]
    terms = resolve(replace(load_robot("xs031"), effects=tuple(usual)))
    base = rubbing.base
    alone, apart = (
        Contest(rubbing.training, processes=count).fitted(base, terms, base.bench.noise)
        for count in (1, 2)
    )
    assert len(alone) == len(terms)
    assert alone[0].gain > 0.5 * base.squares
    for one, other in zip(alone, apart, strict=True):
        assert one.term.effect is other.term.effect
        assert (one.gain, one.held_out, one.cost) == (other.gain, other.held_out, other.cost)
        assert np.array_equal(one.term.parameters, other.term.parameters)
        assert np.array_equal(one.fitted.left, other.fitted.left)


@pytest.mark.thorough
def test_a_search_finds_the_same_to_the_last_bit(rubbing: Residuals) -> None:
    alone, apart = (searched(replace(rubbing, processes=count), rubbing.base) for count in (1, 3))
    assert [f.named.term.effect.name for f in alone[2]] == ["coulomb_friction"]
    assert [_numbers(f) for f in alone[2]] == [_numbers(f) for f in apart[2]]
    assert [_numbers(f) for f in alone[3]] == [_numbers(f) for f in apart[3]]
    assert np.array_equal(alone[1].residual, apart[1].residual)
    assert [s.value for s in alone[0].scanned] == [s.value for s in apart[0].scanned]


def _numbers(found: Any) -> tuple[Any, ...]:
    tried = [(c.name, c.term.parameters.tolist(), c.gain, c.held_out) for c in found.named.tried]
    said = found.verification
    return found.named.names, found.named.probability, tried, said.p_value, said.after
