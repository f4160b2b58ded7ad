"""Where the fits of trials begin: the size, shape and instant of what explains most as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.stepping import form_of
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.onset import Sight, ends
from hydro_ident.mismatch.trials.grids import between_tried
from hydro_ident.mismatch.trials.places import instant_spacing, instants_of
from hydro_ident.mismatch.trials.scoring import Score
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Shapes of a trial from which its fit may begin, and how many it does begin from.
_SHAPES, _HOLLOWS = 4, 2
#: What has begun ends again where that explains so much more, in squares of whitened noise.
_END = 50.0


class Starts:
    """Makes starts of fits of trials.

    Parameters
    ----------
    training : Training
    """

    def __init__(self, training: Training) -> None:
        self.training = training

    def of(self, without: Fitted, best: Score, scores: Sequence[Score]) -> list[ActiveEffect]:
        """Where fits of a trial begin: of what does not grow like its size, in further shapes.

        What opens or shuts somewhere, or rings at some frequency, has as many hollows as shapes: a
        column tells which is the deepest no better than roughly. What fits leave as it is has no
        way from one of its values to another: each is begun from.

        Parameters
        ----------
        without : Fitted
            The model beside which it is fitted.
        best : Score
            Of the trial.
        scores : sequence of Score
            Of all trials.
        """
        trial = best.entry.trial
        same = [s for s in scores if s.entry.trial.active.effect is trial.active.effect]
        same = [s for s in same if s.entry.trial.target == trial.target]
        same.sort(key=lambda s: -s.value)
        if trial.free != (-1,):
            forms = {form_of(s.entry.trial.active): s for s in reversed(same)}
            deepest = sorted(forms.values(), key=lambda s: -s.value)
            return [self._tuned(without, self.start(without, s)) for s in deepest[:_HOLLOWS]]
        starts = [self.start(without, s) for s in same[:_SHAPES]]
        left = self._left(without, starts)
        return [starts[k] for k in np.argsort(left)[:_HOLLOWS]]

    def start(self, without: Fitted, one: Score) -> ActiveEffect:
        """The size of a trial that explains most as it is: what a fit starts from.

        Parameters
        ----------
        without : Fitted
        one : Score
            Of the trial beside it.
        """
        starts = one.entry.trial.around(one.coefficients)
        if starts[0].effect.start:
            return self._timed(without, starts[0])
        if len(starts) == 1:
            return starts[0]
        return starts[int(np.argmin(self._left(without, starts)))]

    def _tuned(self, without: Fitted, one: ActiveEffect) -> ActiveEffect:
        """An effect at the best of the values between those tried, and its size there.

        What rings hardly damped answers within a few percent of its frequency alone: from farther
        away a fit damps it instead.
        """
        beside = between_tried(one)
        if not beside:
            return one
        bench, mask = without.bench, self.training.mask
        columns = np.stack(
            [self.training.predictor.contribution(without.model, t)[mask] for t in beside], axis=1
        )
        shown = bench.beyond(columns)
        products = np.maximum(bench.residual @ shown, 0.0)
        squares = np.maximum(np.sum(shown**2, axis=0), 1e-300)
        best = int(np.argmax(products**2 / squares))
        values = beside[best].parameters.copy()
        values[one.effect.sizes[0]] *= products[best] / squares[best]
        found = replace(beside[best], parameters=values)
        return found if values[one.effect.sizes[0]] > 0.0 else one

    def _timed(self, without: Fitted, one: ActiveEffect) -> ActiveEffect:
        """An effect that may come and go within the recording, when it does, and its size then."""
        predictor, mask, bench = self.training.predictor, self.training.mask, without.bench

        def column(of: ActiveEffect) -> FloatArray:
            return bench.beyond(predictor.contribution(without.model, of)[mask][:, None])[:, 0]

        sight = Sight(column, bench.residual, sized=False, least=_END)
        instants_s = instants_of(predictor.material)
        single = sight.first(one, instants_s) if ends(one) else one
        found = sight.placed(single, instant_spacing(predictor.material), instants_s)
        values, shown = found.parameters.copy(), column(found)
        share = float(shown @ bench.residual) / max(float(shown @ shown), 1e-300)
        values[one.effect.sizes[0]] *= share
        return replace(found, parameters=values)

    def _left(self, without: Fitted, terms: Sequence[ActiveEffect]) -> FloatArray:
        """Sums of squares that effects leave as they are, (k,)."""
        mask, bench = self.training.mask, without.bench
        columns = np.stack(
            [self.training.predictor.contribution(without.model, t)[mask] for t in terms], axis=1
        )
        left = bench.residual[:, None] - bench.beyond(columns)
        return np.asarray(np.sum(left**2, axis=0))
