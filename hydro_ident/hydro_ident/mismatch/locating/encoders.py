"""What the encoders' noise alone lets laws of acceleration explain.

Behind its filters an acceleration is noise where a machine moves slowly, and inertia carries that
noise into the residual. A law that takes part of the inertia away again, as a spring does above
its frequency, explains noise by the same noise: errors in variables (Fuller, Measurement Error
Models, 1987, section 1.1). How much of it is told by recordings with noise added once more: what
that adds to residual and law goes together as what was there before does. There is no more noise
than a fit with the law leaves: where the encoders' is less than their resolution lets expect, what
is added is scaled down to that. What is compared with it is what the law lets through of the added
noise: a spring that takes inertia away keeps most of it out, of both alike.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from hydro_ident.estimate.forces.force_rows import Motion
from hydro_ident.estimate.scoring.noise import encoder_noise
from hydro_ident.estimate.signals.derivatives import FilterSettings, motion
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.lines import independent_noise
from hydro_ident.mismatch.rows.material import Stretch
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.trials.contender import Contender
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.robot import FloatArray

#: Effects of joints' accelerations.
OF_ACCELERATION = frozenset({"joint_coupling", "rotor_inertia", "structural_flexibility"})
#: Share of an effect's product with the residual from which it is the noise's.
_SHARE = 0.25
#: Share of a line's amplitude that noise makes by weakening inertia, from which it is the noise's.
_SHARE_OF_LINE = 0.5
_TWINS, _SEED = 2, 1


class Encoders:
    """Tells laws of acceleration from the noise of positions.

    Parameters
    ----------
    training : Training
    """

    def __init__(self, training: Training) -> None:
        self.training = training

    def tell(self, without: Fitted, one: Contender) -> bool:
        """Whether a contender is more than the encoders' noise makes of it.

        Parameters
        ----------
        without : Fitted
            The model that it was added to.
        one : Contender
        """
        return one.term.effect.name not in OF_ACCELERATION or self.share(without, one) < _SHARE

    def share(self, without: Fitted, one: Contender) -> float:
        """Share of a contender's product with the residual that is the noise's.

        Parameters
        ----------
        without : Fitted
            The model that it was added to.
        one : Contender
        """
        model, bench, mask = without.model, without.bench, self.training.mask
        predictor = self.training.predictor
        whole, term = one.fitted.model, one.term

        def _seen_by(of: Predictor) -> FloatArray:
            """What is left without and with the law, and what the law does."""
            left = of.residual(model), of.residual(whole), of.contribution(model, term)
            return np.stack(left, axis=1)[mask]

        there = _seen_by(predictor)
        found = float(bench.beyond(there[:, 2:])[:, 0] @ bench.residual)
        by_noise, let_through = 0.0, 0.0
        forced = self._forced(bench.channel)
        for twin in self._twins:
            added = bench.beyond(_seen_by(twin) - there)
            by_noise += float(added[:, 0] @ added[:, 2])
            let_through += float(np.sum(added[forced, 1] ** 2)) / _TWINS
        by_noise *= _there(one.fitted.left[forced], let_through) / _TWINS
        return by_noise / found if found > 0.0 else 1.0

    def makes(self, whole: Fitted, one: Dependence) -> bool:
        """Whether a line over time in a force is no more than noise makes of inertia.

        Noise of accelerations makes the inertia that is fitted too small, and a line beside it
        has what is missing where the motion swings. Noise that is added once more makes it larger
        still, by as much.

        Parameters
        ----------
        whole : Fitted
            What the line was found in.
        one : Dependence
        """
        material = self.training.predictor.material
        in_time = one.variable == "time" and one.period > 0.0 and not one.times
        if not in_time or material.is_flow(one.channel):
            return False
        rows = np.flatnonzero(material.channel == one.channel)
        turned = np.exp(2j * np.pi * material.time_s[rows] / one.period)
        apart = np.unique(material.recording[rows], return_inverse=True)[1]
        lines = np.zeros((material.size, 2 * (int(apart.max()) + 1)))
        lines[rows, 2 * apart], lines[rows, 2 * apart + 1] = turned.real, turned.imag

        def _sizes(of: Fitted) -> FloatArray:
            left = of.bench.beyond(lines[self.training.mask])
            return np.asarray(np.linalg.lstsq(left, of.bench.residual, rcond=None)[0])

        # Lines are found in rows that are not whitened.
        noise = independent_noise(self.training, whole)
        plain = fitted(self.training, whole.model, noise)
        there, forced = _sizes(plain), self._forced(plain.bench.channel)
        more, squares = np.zeros(there.size), 0.0
        for twin in self._twins:
            again = fitted(replace(self.training, predictor=twin), whole.model, noise)
            more += (_sizes(again) - there) / _TWINS
            added = (again.residual - plain.residual)[self.training.mask, None]
            squares += float(np.sum(plain.bench.beyond(added)[forced] ** 2)) / _TWINS
        more *= _there(plain.bench.residual[forced], squares)
        share = float(there @ more) / max(float(there @ there), 1e-300)
        return share >= _SHARE_OF_LINE

    def _forced(self, channel: IndexArray) -> BoolArray:
        """Whitened rows of force channels, by theirs."""
        material = self.training.predictor.material
        forces = [k for k in range(len(material.channels)) if not material.is_flow(k)]
        return np.asarray(np.isin(channel, forces))

    @cached_property
    def _twins(self) -> list[Predictor]:
        """Predictors of the same recordings with noise added."""
        material, random = self.training.predictor.material, np.random.default_rng(_SEED)
        traces = [stretch.trace for stretch in material.stretches]
        noise = encoder_noise(SignalSurvey.of(material.robot, traces))
        result = []
        for _ in range(_TWINS):
            noisy = tuple(
                _with_noise(s, noise * random.normal(size=s.trace.q.shape), material.filters)
                for s in material.stretches
            )
            result.append(Predictor(replace(material, stretches=noisy)))
        return result


def _there(left: FloatArray, added_squares: float) -> float:
    """Share of added noise that may be there: what is left (M,) holds it, and is no less."""
    return min(1.0, float(left @ left) / max(added_squares, 1e-300))


def _with_noise(stretch: Stretch, noise: FloatArray, filters: FilterSettings) -> Stretch:
    """A stretch whose joints that move are read with noise (T, n) added."""
    if stretch.moved is None:
        return stretch
    trace, still = stretch.trace, np.ptp(stretch.moved.q, axis=0) == 0.0
    q = trace.q + np.where(still, 0.0, noise)
    seen = np.where(still, stretch.moved.q, q)
    moved = Motion(*motion(seen, trace.step_s, filters))
    return replace(stretch, trace=replace(trace, q=q), moved=moved)
