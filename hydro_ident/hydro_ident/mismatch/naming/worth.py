"""What an effect has to be before it counts: more than form, precision and sampling leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.precision import drift_of, least_unconfirmed, measured_size
from hydro_ident.mismatch.rows.onset import begins, ends
from hydro_ident.mismatch.settings import (
    ADDED_SHARE,
    LEAST_SHARE_UNCONFIRMED,
    MOVED,
    PRECISION,
    PRECISION_COMPRESSED,
    PRECISION_FLOW,
)
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.trials.grids import FLANK
from hydro_ident.mismatch.trials.scoring import Score
from hydro_model.effects.catalogue import end_s, start_s
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Effects of where a machine is, not of how it moves: what a drifting transducer does, too, and
#: the share of a usual drift from which they count.
STATIC = frozenset(
    {
        "base_tilt", "constant_force_offset", "counterbalance_spring", "encoder_offset",
        "joint_coupling", "payload_change", "pressure_sensor_bias", "pressure_sensor_gain",
    }
)  # fmt: skip
_STATIC_SHARE = 0.25
#: Laws that each say how far the edges open: what a found one's form leaves looks like another,
#: which therefore has to explain this share (rms) of it.
_OPENINGS = frozenset({"valve_deadband", "valve_underlap", "valve_gain_nonlinearity"})
_OPENING_SHARE = 0.15
#: Laws that are one number added, which nature does not bend.
_OF_ONE_FORM = frozenset({"constant_force_offset", "dead_volume", "valve_null_bias"})
#: Share of the squares left in a channel that is next to all of it.
_NEXT_TO_ALL = 0.95
#: Laws of how much oil is compressed, or how stiff it is.
_COMPRESSED = frozenset({"dead_volume", "entrained_air"})
#: What a joint runs against, the share of its largest force from which it is met, and the share of
#: the rows in which a spring is.
CONTACT, _TOUCHED, _MOSTLY = "external_contact", 0.01, 0.5


def worth(
    training: Training, start: Fitted, current: Fitted, bench: Bench, candidate: Score
) -> bool:
    """Whether an effect is more than a flaw of the model's form and precision.

    Parameters
    ----------
    training : Training
    start : Fitted
        The base alone.
    current : Fitted
        With what was found so far.
    bench : Bench
        Of it, with the noise that the effect would leave.
    candidate : Score
        Of the effect.
    """
    whole = candidate.entry.columns(training.mask.size) @ candidate.coefficients
    active = candidate.entry.trial.active
    return worthy(training, start, current, bench, active, whole, candidate.value)


def worthy(
    training: Training,
    start: Fitted,
    current: Fitted,
    bench: Bench,
    active: ActiveEffect,
    whole: FloatArray,
    gain: float,
) -> bool:
    """As `worth`, of an effect that adds `whole` (N,) to the prediction and gains so much.

    `start` is the fit without it.
    """
    material, mask = training.predictor.material, training.mask
    # What a refit of everything else leaves of it, in the channel's own unit.
    own = training.bench(current.bench.noise, whole, current.columns)
    fresh = (whole - current.columns @ own.solve())[mask]
    channel = material.channel[mask]
    acting = [k for k in np.unique(channel) if whole[mask][channel == k].any()]
    sizes = {k: measured_size(training, start.model, k) for k in acting}
    shares = {k: rms(fresh[channel == k]) / sizes[k] for k in acting}
    of_flows = PRECISION_COMPRESSED if active.effect.name in _COMPRESSED else PRECISION_FLOW
    if all(s < (of_flows if material.is_flow(k) else PRECISION) for k, s in shares.items()):
        return False
    drifts = {k: drift_of(material, k) for k in acting}
    # A kept base makes room for it only beyond what its file says: then all of it counts.
    base = own.solve()[: len(training.predictor.names)]
    counted = whole[mask] if _beyond_kept(training, current, base) else fresh
    if active.effect.name in STATIC and all(
        not material.is_flow(k) and rms(counted[channel == k]) < _STATIC_SHARE * drifts[k]
        for k in acting
    ):
        return False
    if begins(active) or ends(active):
        # No other recording has the same instant, and sensors that drift step a little, too.
        left = current.residual[mask]
        beyond = _beyond_steps(training, current, active, whole)[mask]

        def is_much(part: FloatArray, k: int, least: float) -> bool:
            own = channel == k
            share = LEAST_SHARE_UNCONFIRMED * np.sum(left[own] ** 2)
            return bool(np.sum(part[own] ** 2) >= share and rms(part[own]) >= least)

        if not any(
            is_much(fresh, k, least_unconfirmed(training, start.model, k))
            or is_much(beyond, k, max(PRECISION * sizes[k], _STATIC_SHARE * drifts[k]))
            for k in acting
        ):
            return False
    beside = _opens_beside(active, current.model.terms)
    if not beside and any(
        _is_all_of(fresh[channel == k], current.residual[mask][channel == k]) for k in acting
    ):
        return True
    share = _OPENING_SHARE if beside else ADDED_SHARE
    return gain >= share**2 * _explained(training, current, bench, acting)


def _beyond_kept(training: Training, current: Fitted, step: FloatArray) -> bool:
    """Whether a kept base is further from its file than that says, and a step moves it as far."""
    off = np.abs(training.off(current.model)).max(initial=0.0)
    known = training.prior
    return known is not None and off > MOVED and known.moved(step) > MOVED


def _beyond_steps(
    training: Training, current: Fitted, active: ActiveEffect, whole: FloatArray
) -> FloatArray:
    """What neither a refit nor a step of every channel's sensors can make of it, (N,).

    A load weighs on each cylinder by where the joints stand, and goes with their motion.
    """
    material = training.predictor.material
    acts = (material.time_s >= start_s(active)) & (material.time_s < end_s(active))
    steps = np.equal.outer(material.channel, np.arange(len(material.channels))) & acts[:, None]
    taken = np.concatenate([current.columns, steps[:, steps.any(axis=0)]], axis=1)
    return whole - taken @ training.bench(current.bench.noise, whole, taken).solve()


def _is_all_of(part: FloatArray, left: FloatArray) -> bool:
    """Whether a law is next to all that is left in a channel: what others' forms leave is not."""
    return bool(np.sum((left - part) ** 2) <= (1.0 - _NEXT_TO_ALL) * np.sum(left**2))


def _opens_beside(one: ActiveEffect, terms: Sequence[ActiveEffect]) -> bool:
    """Whether a law of how far a valve opens would stand beside another one of it."""
    return one.effect.name in _OPENINGS and any(
        t.effect.name in _OPENINGS and t.cylinder == one.cylinder for t in terms
    )


def in_reach(training: Training, without: Fitted, one: Contender) -> bool:
    """Whether what a joint runs against is met in less than half of what was recorded.

    What a joint rests on most of the time is a spring, or whatever else follows its position.

    Parameters
    ----------
    training : Training
    without : Fitted
        The model that it was added to.
    one : Contender
    """
    if one.term.effect.name != CONTACT or one.term.everywhere:
        return True
    column = np.abs(training.predictor.contribution(without.model, one.term))
    acting = np.unique(training.predictor.material.channel[column > 0.0])
    own = column[np.isin(training.predictor.material.channel, acting)]
    return bool(own.size) and float(np.mean(own > _TOUCHED * own.max())) < _MOSTLY


def bears(training: Training, one: Contender) -> bool:
    """Whether the flanks of a drive's play come to bear under the torques that were recorded.

    What only ever gives way further is no play, but a shaft or a link that is soft.

    Parameters
    ----------
    training : Training
    one : Contender
    """
    term = one.term
    values = zip(term.effect.parameters, term.parameters.tolist(), strict=True)
    flank = next((value for spec, value in values if spec.name == FLANK), None)
    if flank is None or term.joint is None:
        return True
    stretches = training.predictor.material.stretches
    loads = [np.abs(s.trace.joint_torque[:, term.joint]) for s in stretches]
    return any(bool(np.any(load > flank)) for load in loads)


def _explained(training: Training, current: Fitted, bench: Bench, acting: Sequence[int]) -> float:
    """Sum of squares that the effects found so far explain in some channels."""
    material, predictor = training.predictor.material, training.predictor
    base = current.columns[:, : len(predictor.names)]
    alone = training.bench(bench.noise, current.residual, base, current.offset)
    total = 0.0
    for term in current.model.terms:
        effect = term.effect
        if effect.name in _OF_ONE_FORM or (
            not effect.states and (effect.change is not None or effect.reading is not None)
        ):
            # Geometry, mass and time have one form: nothing of it is left over. A mode has not.
            continue
        column = predictor.contribution(current.model, term)
        if any(column[material.channel == k].any() for k in acting):
            total += float(np.sum(alone.beyond(column[training.mask][:, None]) ** 2))
    return total
