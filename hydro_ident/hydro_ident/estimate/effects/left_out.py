"""How far physics that a model leaves out may have moved its parameters.

Standard deviations say how far noise moves a parameter; they shrink with the length of a
recording. What a model lacks does not: another motion of the same machine lets it pass for other
parameters, by as much as it looks like their columns. The residual shows its size. With ``X'``
the part of a column that the others do not explain, a residual of root mean square e moves the
parameter by at most

    e / rms(X'),    for all of them together:  e^2 G^-1,  G = X'X / N,

reached where the residual looks just like ``X'``. A `SHARE` of that is counted as one standard
deviation: a third, so that the whole of it is three.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.shared_parameters import scale_free_inverse
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.scoring.scores import ChannelScore
from hydro_ident.estimate.statistics.least_squares import Fit
from hydro_model.robot import FloatArray

#: Standard deviation of the error, as a share of the largest that the residual could make.
SHARE = 1.0 / 3.0
#: So many times the noise floor may be noise: the floor is propagated from survey estimates.
NOISE_MARGIN = 2.0
#: Singular directions of normalised columns end here.
_SINGULAR = 1.0e-12


def left_out_rms(scores: Sequence[ChannelScore]) -> dict[str, float]:
    """What each scored channel's residual holds beyond sensor noise.

    Parameters
    ----------
    scores : sequence of ChannelScore
        On rows that took no part in the fit.

    Returns
    -------
    dict of str to float
        Root mean square in the channel's unit, by channel.
    """
    found = {}
    for score in scores:
        summary = score.summary()
        noise = NOISE_MARGIN * float(summary["noise_floor"])
        found[score.name] = math.sqrt(max(float(summary["rmse_after"]) ** 2 - noise**2, 0.0))
    return found


def force_errors(fit: InertialFit, left_out: Mapping[str, float]) -> FloatArray:
    """Covariance that left-out physics adds to the parameters of the force channels.

    Parameters
    ----------
    fit : InertialFit
    left_out : mapping of str to float
        Of `left_out_rms`; a channel without score counts its whole residual.

    Returns
    -------
    (p, p) array
        In the order of the model's names; zero for what is held.
    """
    count = len(fit.model.names)
    held = [part.index for part in fit.held]
    free = np.setdiff1d(np.arange(count), held)
    gram = fit.fit.gram
    if gram.shape[0] == count:
        gram = gram[np.ix_(free, free)]
    result = np.zeros((count, count))
    size = _size(fit.fit, fit.model.channels, left_out)
    result[np.ix_(free, free)] = (SHARE * size) ** 2 * _inverse(gram)
    return result


def cylinder_errors(fit: CylinderFit, left_out: Mapping[str, float]) -> FloatArray:
    """Covariance that left-out physics adds to a cylinder's hydraulic parameters.

    Parameters
    ----------
    fit : CylinderFit
    left_out : mapping of str to float
        As for `force_errors`.

    Returns
    -------
    (p, p) array
        In the order of its names: errors of the chambers, weighted as the chambers were. Zero for
        what is held, and for what the chambers say nothing about, as of an edge never opened.
    """
    count = len(fit.names)
    information, middle = np.zeros((count, count)), np.zeros((count, count))
    for chamber in fit.chambers:
        square = np.ix_(*[[fit.names.index(name) for name in chamber.names]] * 2)
        own = scale_free_inverse(chamber.fit.covariance)
        share = SHARE * _size(chamber.fit, (chamber.chamber.channel,), left_out)
        information[square] += own
        middle[square] += own @ (share**2 * _inverse(chamber.fit.gram)) @ own
    # Values are held beside the others' information, as `conditioned` does it.
    held = [part.index for part in fit.held]
    free = np.ix_(*[np.setdiff1d(np.arange(count), held)] * 2)
    spread = scale_free_inverse(information[free])
    result = np.zeros((count, count))
    result[free] = spread @ middle[free] @ spread
    return result


def _size(fit: Fit, channels: Sequence[str], left_out: Mapping[str, float]) -> float:
    """Largest left-out residual over the residual that the columns are in units of."""
    pairs = zip(channels, fit.channel_std.tolist(), strict=False)
    sizes = [left_out.get(name, std) / std for name, std in pairs if std > 0.0]
    return max(sizes, default=0.0)


def _inverse(gram: FloatArray) -> FloatArray:
    """Inverse of a product of columns; what they do not tell has an error beyond any size."""
    lengths = np.sqrt(np.diag(gram))
    used = lengths > 0.0
    lengths = np.where(used, lengths, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(lengths, lengths))
    inverse = (vectors / np.maximum(values, _SINGULAR)) @ vectors.T
    return np.asarray(inverse / np.outer(lengths, lengths))
