"""What laws of listed effects look at, where they act, and which of their numbers are fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hydro_model.effects.compiled import signals_read
from hydro_model.effects.law import COMPLIANCE, FLOW, VOLUME, Stage
from hydro_model.effects.signals import SIGNAL_COUNT
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: The one law on the valve signal that is fitted, by Gauss-Newton steps.
NULL_BIAS = "valve_null_bias.bias"


def is_dead(one: ActiveEffect) -> bool:
    """Whether it adds to the volume of chambers."""
    return any(term.stage in VOLUME.values() for term in one.effect.terms)


def is_bias(one: ActiveEffect) -> bool:
    """Whether it is the law that Gauss-Newton steps fit."""
    return one.effect.name == NULL_BIAS.split(".", 1)[0]


def in_chambers(one: ActiveEffect) -> bool:
    """Whether it acts on the balances of chambers."""
    stages = {*FLOW.values(), *VOLUME.values(), *COMPLIANCE.values()}
    return bool(stages.intersection(one.effect.stages))


def looks_at(one: ActiveEffect) -> set[int]:
    """The signals that an effect's laws and states look at."""
    laws = [term.law for term in one.effect.terms]
    laws += [law for state in one.effect.states for law in (state.rate, state.initial)]
    return set[int]().union(*(signals_read(law) for law in laws))


def bends_edges(one: ActiveEffect) -> bool:
    """A law whose size counts in the edges' own flow, or which acts on one chamber alone."""
    return in_chambers(one) and (one.effect.needs_valve or bool(one.side))


def fits(one: ActiveEffect) -> bool:
    """Whether any of its numbers can be fitted."""
    return bool(linear_names(one)) or is_bias(one)


def linear_names(one: ActiveEffect) -> list[str]:
    """Names `<effect>.<parameter>` of its linear parameters."""
    return [f"{one.effect.name}.{p.name}" for p in one.effect.parameters if p.linear]


def acting(one: ActiveEffect, stage: Stage) -> NDArray[np.bool_]:
    """Which linear parameters a stage's law depends on, seen at a probe of distinct signals."""
    rising = 1.0e5 * np.arange(1.0, SIGNAL_COUNT + 1.0)
    # What has internal states is at rest in the first row and moves when the signals turn.
    probe = np.array([rising, -rising, rising])
    return np.asarray((one.effect.columns(probe, one.parameters, stage, 1e-3) != 0.0).any(axis=0))


def middle(values: FloatArray) -> FloatArray:
    """Values half way between samples, (N - 1, ...)."""
    return np.asarray(0.5 * (values[1:] + values[:-1]))
