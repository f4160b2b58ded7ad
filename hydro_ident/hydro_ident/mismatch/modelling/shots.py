"""Windows of recordings to shoot over: their starts, and how far a robot's roll-outs miss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.effects.held_effects import sensor_errors
from hydro_ident.estimate.scoring.noise import encoder_noise, pressure_noise
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import low_pass
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.mismatch.rows.material import Stretch
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.rollouts.rollout_windows import Piece, rolled_out, spread, usable_pieces, windows
from hydro_model.effects.targets import ActiveEffect
from hydro_model.errors import SimulationError
from hydro_model.robot import FloatArray, Robot


@dataclass(slots=True)
class Shots:
    """Windows of some recordings.

    A window starts from the measured state, smoothed as the force rows are: what the sensors'
    noise leaves of it moves a window far less than the model's errors do, and as unknowns the
    states would be most of the fit.

    Attributes
    ----------
    predictor : Predictor
        Of the recordings.
    spans : tuple of (int, int, int, int)
        Stretch of every window, its first sample and end, and from when on all is known before.
    rollouts : int
        Made so far.
    """

    predictor: Predictor
    spans: tuple[tuple[int, int, int, int], ...]
    rollouts: int = 0

    @staticmethod
    def of(predictor: Predictor, split: HoldOut, window_s: float, most: int, held: bool) -> Shots:
        """At most `most` held-out windows, or others, evenly spread over the recordings.

        `split` says which rows are held out.
        """
        material, found = predictor.material, list[tuple[int, Piece]]()
        for number, stretch in enumerate(material.stretches):
            for piece in usable_pieces(material.robot, stretch.trace, material.filters):
                found += [(number, one) for one in windows(piece, split, window_s, held)]
        chosen = spread([one for _, one in found], most)
        stretch_of = {id(one): number for number, one in found}
        spans = tuple((stretch_of[id(p)], p.begin, p.end, p.since) for p in chosen)
        return Shots(predictor, spans)

    def errors(self, robot: Robot, terms: Sequence[ActiveEffect]) -> list[FloatArray | None]:
        """Measured less predicted, (T, n + 2 m) by window: positions, pressures of A and of B.

        Parameters
        ----------
        robot : Robot
        terms : sequence of ActiveEffect
            Its effects; what they say of sensors alone is taken out of what was measured. What
            also changes the robot, such as a delay of its commands, its roll-out has already.

        Returns
        -------
        list of array or None
            None where a window cannot be integrated.
        """
        stretches = self.predictor.signals.readings.corrected(sensor_errors(terms))
        return [self._missed(robot, stretches[number], *own) for number, *own in self.spans]

    def only(self, kept: Sequence[bool]) -> Shots:
        """Some of the windows.

        `kept` says of each window whether it stays.
        """
        spans = tuple(span for span, keep in zip(self.spans, kept, strict=True) if keep)
        return replace(self, spans=spans)

    def _missed(
        self, robot: Robot, stretch: Stretch, begin: int, end: int, since: int
    ) -> FloatArray | None:
        if stretch.moved is None:
            return None
        trace, at = stretch.trace, slice(begin, end)
        piece = Piece(trace, begin, end, stretch.moved.qd, since)
        start = stretch.moved.q[begin], stretch.moved.qd[begin], self._pressures(stretch, begin)
        self.rollouts += 1
        try:
            out = rolled_out(robot, piece, start)
        except SimulationError:
            return None
        pairs = ((trace.q, out.q), (trace.p_a, out.p_a), (trace.p_b, out.p_b))
        return np.concatenate([seen[at] - there for seen, there in pairs], axis=1)

    def _pressures(self, stretch: Stretch, at: int) -> FloatArray:
        """Smoothed pressures at a sample, (m, 2)."""
        trace, filters = stretch.trace, self.predictor.material.filters
        reach = filters.edge_samples(trace.step_s)
        begin, end = max(at - reach, 0), min(at + reach + 1, trace.samples)
        seen = np.stack([trace.p_a[begin:end], trace.p_b[begin:end]], axis=2)
        smooth = low_pass(seen, trace.step_s, filters.differentiation_hz, filters.order)
        return np.asarray(smooth[at - begin])


def sensor_noise(robot: Robot, signals: SignalSurvey) -> FloatArray:
    """Noise of positions and pressures, (n + 2 m,), in the order of `Shots.errors`."""
    pressures = [pressure_noise(robot, sensor) for sensor in (*signals.p_a, *signals.p_b)]
    return np.array([*encoder_noise(signals), *pressures])


def weights_of(errors: Sequence[FloatArray], noise: FloatArray) -> FloatArray:
    """Weights of the samples' errors by channel, (c,): one over their usual size.

    The usual one of windows' errors, at least the sensor's noise: what a model misses by form is
    far more than noise, and differs by channel.

    Parameters
    ----------
    errors : sequence of (T, c) array
    noise : (c,) array
    """
    squares = np.array([np.mean(e**2, axis=0) for e in errors])
    return np.asarray(1.0 / np.sqrt(np.maximum(np.median(squares, axis=0), noise**2)))
