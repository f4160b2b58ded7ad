"""Forces against the motion that are there in some stretches of time and not in others.

No function of the state is such a force, it does not repeat, and it comes and goes faster than
smooth functions of time are looked at (`locate`). Of a channel of forces the direction of motion
is put to every stretch by itself: it has to go with what is left on the average, by flips of whole
blocks, and its size has to differ between stretches by more than chance (`constancy`), and much.
What slow noise and drifting transducers add knows nothing of the direction of motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import combine_pvalues

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import alone, values_of
from hydro_ident.mismatch.locating.flaws import Flaws
from hydro_ident.mismatch.locating.precision import least_unconfirmed
from hydro_ident.mismatch.rows.state_space import factors_of
from hydro_ident.mismatch.settings import FAMILY_ERROR_UNNAMED
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.trials.chance import reached
from hydro_ident.mismatch.trials.constancy import COMES_AND_GOES, Sizes, sizes_of
from hydro_ident.mismatch.trials.products import paid
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_ident.mismatch.verifying.looks import VERIFIED
from hydro_model.robot import FloatArray

#: Blocks that make a stretch: what comes and goes may do so quickly or slowly.
_TOGETHER = (1, 3)
#: Share of what named effects do that their laws' form may leave: as much as true ones of forces
#: change from stretch to stretch (`constancy`).
_OF_NAMED = 0.25
#: Share of the direction of motion (of its squares) that the model leaves at least: beside a named
#: dry friction next to nothing is, and a size by that is none.
_LEFT = 0.01
#: Chance that neither the mean nor its changes may exceed, and the least that is told from none.
_EACH, _NEVER = 0.05, 1.0e-300
#: Deviations of what is left from which rows that took no part would show a force.
_SHOWS = 2.0


@dataclass(frozen=True, slots=True)
class Wavering:
    """A force against the motion that comes and goes.

    Attributes
    ----------
    mean, deviation : float
        Over time, in the channel's unit.
    p_value : float
        That it is there on average, and differs between stretches, by chance: Fisher's
        combination of the two, over all channels.
    confirmed : bool
        It is there on rows that took no part, too; else these could not say.
    """

    mean: float
    deviation: float
    p_value: float
    confirmed: bool = False


def wavering(training: Training, fitted: Fitted, confirmer: Confirmer) -> dict[str, Wavering]:
    """Forces against the motion that come and go, here and on rows that took no part.

    Parameters
    ----------
    training : Training
    fitted : Fitted
        With all findings.
    confirmer : Confirmer

    Returns
    -------
    dict of str to Wavering
        By channel.
    """
    material = training.predictor.material
    forces = [k for k in range(len(material.channels)) if not material.is_flow(k)]
    flaws, result = Flaws.of(training, fitted), dict[str, Wavering]()
    for channel in forces:
        one = _wavering(training, fitted, flaws, channel, len(forces))
        name = material.channels[channel]
        there = None if one is None else _there(confirmer, name, one.mean)
        if one is None or there is False:
            continue
        if there or one.deviation >= least_unconfirmed(training, fitted.model, channel):
            result[name] = replace(one, confirmed=bool(there))
    return result


def _wavering(
    training: Training, fitted: Fitted, flaws: Flaws, channel: int, tried: int
) -> Wavering | None:
    bench, direction = _direction(training, fitted, channel)
    if bench is None or not _is_left(bench, direction):
        return None
    every = [sizes_of(bench, direction, together) for together in _TOGETHER]
    best: Sizes = min(every, key=lambda one: one.chance)
    chances = _chance(bench, direction), min(paid([max(one.chance, _NEVER) for one in every]))
    p = min(1.0, tried * float(combine_pvalues(chances, method="fisher").pvalue))
    size = best.deviation * rms(direction)
    if (
        p > FAMILY_ERROR_UNNAMED
        or max(chances) > _EACH
        or best.deviation < COMES_AND_GOES * best.mean
        or size < flaws.least(channel, tolerance=_OF_NAMED)
    ):
        return None
    return Wavering(best.mean, best.deviation, p)


def _there(confirmer: Confirmer, name: str, mean: float) -> bool | None:
    """Whether rows that took no part have such a force on the average, or changing, too.

    None where a force of that mean would not stand out of what is left there.
    """
    training = confirmer.training
    names = training.predictor.material.channels
    if name not in names:
        return None
    bench, direction = _direction(training, confirmer.fitted, names.index(name))
    if bench is None:
        return None
    chances = _chance(bench, direction), sizes_of(bench, direction, _TOGETHER[0]).chance
    if min(paid([max(one, _NEVER) for one in chances])) <= VERIFIED:
        return True
    left = bench.beyond(direction[:, None])
    products = bench.by_block(left * bench.residual[:, None])
    expected = mean * float(np.sum(left[: bench.measured] ** 2))
    return False if expected >= _SHOWS * float(np.linalg.norm(products)) else None


def _direction(
    training: Training, fitted: Fitted, channel: int
) -> tuple[Bench | None, FloatArray]:
    """A channel's bench and the direction of motion on its rows; no bench where it is unknown."""
    own, bench = alone(training, fitted, channel)
    if bench is None:
        return None, np.zeros(0)
    values = values_of(own, fitted, channel)
    factors = factors_of(own.predictor, fitted.model, channel, values, own.mask)
    direction = factors["direction"][own.mask]
    return (bench if np.isfinite(direction).all() else None), direction


def _is_left(bench: Bench, direction: FloatArray) -> bool:
    """Whether enough of the direction of motion is none of the model's columns."""
    part = bench.partial(direction[:, None])
    return bool(part.gram[0, 0] >= _LEFT * part.plain[0])


def _chance(bench: Bench, direction: FloatArray) -> float:
    """Share of flips of blocks in which the direction goes as far with what is left."""
    left = bench.beyond(direction[:, None])[:, 0]
    return reached(bench.by_block((left * bench.residual)[:, None])[:, 0])
