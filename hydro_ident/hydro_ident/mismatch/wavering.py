"""Forces against the motion that are there in some stretches of time and not in others.

No function of the state is such a force, it does not repeat, and it comes and goes faster than
smooth functions of time are looked at (`locate`). Of a channel of forces the direction of motion
is put to every stretch by itself: it has to go with what is left on the average, by flips of whole
blocks, and its size has to differ between stretches by more than chance (`constancy`), and much.
What slow noise and drifting transducers add knows nothing of the direction of motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.chance import reached
from hydro_ident.mismatch.confirm import Confirmer
from hydro_ident.mismatch.constancy import COMES_AND_GOES, Sizes, sizes_of
from hydro_ident.mismatch.dependence import alone, values_of
from hydro_ident.mismatch.fitting import Fitted
from hydro_ident.mismatch.flaws import Flaws
from hydro_ident.mismatch.held_out import VERIFIED, rms
from hydro_ident.mismatch.settings import FAMILY_ERROR, FAMILY_ERROR_UNNAMED
from hydro_ident.mismatch.state_space import factors_of
from hydro_ident.mismatch.training import Training
from hydro_model.robot import FloatArray

#: Blocks that make a stretch: what comes and goes may do so quickly or slowly.
_TOGETHER = (1, 3)
#: Share of what named effects do that their laws' form may leave: as much as true ones of forces
#: change from stretch to stretch (`constancy`).
_OF_NAMED = 0.25


@dataclass(frozen=True, slots=True)
class Wavering:
    """A force against the motion that comes and goes.

    Attributes
    ----------
    mean, deviation : float
        Over time, in the channel's unit.
    p_value : float
        That its size differs between stretches by chance, over all channels.
    """

    mean: float
    deviation: float
    p_value: float


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
    result = {}
    for channel in forces:
        one = _wavering(training, fitted, channel, len(forces))
        name = material.channels[channel]
        if one is not None and _goes_on(confirmer.training, confirmer.fitted, name):
            result[name] = one
    return result


def _wavering(training: Training, fitted: Fitted, channel: int, tried: int) -> Wavering | None:
    bench, direction = _direction(training, fitted, channel)
    if bench is None:
        return None
    every = [sizes_of(bench, direction, together) for together in _TOGETHER]
    best: Sizes = min(every, key=lambda one: one.chance)
    p = min(1.0, len(every) * tried * best.chance)
    size = best.deviation * rms(direction)
    if (
        p > FAMILY_ERROR_UNNAMED
        or best.deviation < COMES_AND_GOES * best.mean
        or tried * _chance(bench, direction) > FAMILY_ERROR
        or size < Flaws.of(training, fitted).least(channel, tolerance=_OF_NAMED)
    ):
        return None
    return Wavering(best.mean, best.deviation, p)


def _goes_on(training: Training, fitted: Fitted, name: str) -> bool:
    """Whether rows that took no part have such a force on the average, or changing, too."""
    names = training.predictor.material.channels
    if name not in names:
        return False
    bench, direction = _direction(training, fitted, names.index(name))
    if bench is None:
        return False
    chances = _chance(bench, direction), sizes_of(bench, direction, _TOGETHER[0]).chance
    return len(chances) * min(chances) <= VERIFIED


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


def _chance(bench: Bench, direction: FloatArray) -> float:
    """Share of flips of blocks in which the direction goes as far with what is left."""
    left = bench.beyond(direction[:, None])[:, 0]
    return reached(bench.by_block((left * bench.residual)[:, None])[:, 0])
