"""Two simple ways of naming, to measure the diagnosis against.

They take the same rows and the same candidates. Neither knows of autocorrelation, of held-out
rows or of a chance level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.settings import MOST_EFFECTS
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.scoring import Entry, Score, score

#: What "always Coulomb" answers.
ALWAYS = "coulomb_friction"


@dataclass(frozen=True, slots=True)
class BaselineFinding:
    """A name that a baseline gives.

    Attributes
    ----------
    name, target, channel : str
        The channel is the one in which the effect gains most.
    """

    name: str
    target: str
    channel: str


def greedy_bic(work: Residuals) -> tuple[BaselineFinding, ...]:
    """Forward selection by Schwarz's criterion, rows taken as independent.

    Parameters
    ----------
    work : Residuals
        Of `hydro_ident.mismatch.split.residuals.residuals`.

    Returns
    -------
    tuple of BaselineFinding
        In the order in which they were added.
    """
    training, fitted = work.scan, work.base
    columns = _base_columns(training, fitted)
    residual = _residual(training, fitted)
    entries = work.bank.entries(fitted.model)
    found: list[BaselineFinding] = []
    while len(found) < MOST_EFFECTS:
        noise = _white(training, residual, columns)
        bench = training.bench(noise, residual, columns)
        scores = [s for e in _others(entries, found) if (s := score(bench, e, training.mask))]
        if not scores:
            break
        best = max(scores, key=lambda s: _bic(s, bench.measured))
        if _bic(best, bench.measured) <= 0.0:
            break
        trial = best.entry.trial
        found.append(BaselineFinding(trial.name, trial.target, _channel(training, bench, best)))
        used = best.coefficients != 0.0
        fresh = best.entry.columns(training.predictor.material.size)[:, used]
        columns = np.concatenate([columns, fresh], axis=1)
    return tuple(found)


def always_coulomb(work: Residuals) -> tuple[BaselineFinding, ...]:
    """Coulomb friction in the force channel whose residual is largest beside its noise floor."""
    material = work.training.predictor.material
    floors = work.noise_floors()
    forces = [k for k in range(len(material.channels)) if not material.is_flow(k)]
    if not forces:
        return ()

    def excess(channel: int) -> float:
        own = (material.channel == channel) & work.training.mask
        size = float(np.sqrt(np.mean(work.base.residual[own] ** 2)))
        return size / max(floors[material.channels[channel]], 1e-300)

    worst = max(forces, key=excess)
    joint = material.robot.joint_names[material.joint_of(worst)]
    owners = [c.name for c in material.robot.cylinders if c.joint == joint]
    return (BaselineFinding(ALWAYS, (owners or [joint])[0], material.channels[worst]),)


def _bic(one: Score, rows: int) -> float:
    """Improvement of the criterion, with the noise's variance known."""
    return one.gain - float(np.log(rows)) * np.count_nonzero(one.coefficients)


def _white(training: Training, residual: np.ndarray, columns: np.ndarray) -> Noise:
    """Independent noise of every channel, of the size that a refit leaves."""
    count = len(training.predictor.material.channels)
    plain = tuple(np.zeros(0) for _ in range(count))
    channel = training.predictor.material.channel
    std = np.ones(count)
    for _ in range(2):
        bench = training.bench(Noise(plain, std), residual, columns)
        left = residual - columns @ bench.solve()
        for k in range(count):
            own = left[(channel == k) & training.mask]
            std[k] = max(float(np.std(own)), float(training.floor[k])) if own.size else 1.0
    return Noise(plain, std)


def _others(entries: Sequence[Entry], found: Sequence[BaselineFinding]) -> list[Entry]:
    taken = {(f.name, f.target) for f in found}
    return [e for e in entries if (e.trial.name, e.trial.target) not in taken]


def _channel(training: Training, bench: Bench, best: Score) -> str:
    """The channel in which most of what an effect gains is: squares beyond a refit, over noise."""
    columns = best.entry.columns(training.mask.size) @ best.coefficients
    fresh = bench.beyond(columns[training.mask][:, None])[: bench.measured, 0]
    channels = training.predictor.material.channels
    own = bench.channel[: bench.measured]
    gains = np.bincount(own, weights=fresh**2, minlength=len(channels))
    return channels[int(np.argmax(gains))]


def _base_columns(training: Training, fitted: Fitted) -> np.ndarray:
    from hydro_ident.mismatch.fitting.slopes import linearised

    return linearised(training.predictor, fitted.model)[1]


def _residual(training: Training, fitted: Fitted) -> np.ndarray:
    from hydro_ident.mismatch.fitting.slopes import linearised

    return linearised(training.predictor, fitted.model)[0]
