"""Windows of the balances over which a valve's own noise does not pass for soft or stiff oil.

What a valve lets through by chance fills its chambers, and the pressure that rises with it stands
in the balance as a regressor: whatever the balance lacks has driven it. Least squares then makes
the oil too stiff (by half, on quiet work with a noisy spool), and what is left follows pressures
and compression, as physics left out would. The shorter the windows, the more of the rise is
chance; over longer ones the motion's own rise takes over and the estimate settles. Two windows
are therefore compared, as in Hausman's test of a regressor (Econometrica 46, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.estimate.forces.force_rows import ForceModel
from hydro_ident.estimate.forces.standstill import Rest
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.fitting import settled as settled_fit
from hydro_ident.mismatch.fitting.stepping import at_longest_delay
from hydro_ident.mismatch.fitting.training import Training, start_model
from hydro_ident.mismatch.rows.choices import Choices
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.rows.telling import telling
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import Robot

#: Lengths that are tried beside the usual one, in s.
LENGTHS_S = (0.1, 0.2)
#: Deviations by which compliance has to grow with the windows.
_DEVIATIONS = 3.0
#: Flow rows per cylinder without which nothing is compared.
_LEAST_ROWS = 200

_TEXT = (
    "over short windows the oil looks stiffer, as where a valve's own noise drives the pressures:"
    " flows are looked at over {:.2g} s; nothing quicker can be told"
)


@dataclass(frozen=True, slots=True)
class _Balances:
    """The base fitted to the chambers' balances alone."""

    training: Training
    base: Fitted

    def stiffer_than(self, longer: _Balances) -> bool:
        """Whether oil looks stiffer here than over longer windows, and no lag explains it."""
        here, there = self._values(), longer._values()
        deviations = np.sqrt(np.maximum(np.diag(longer.base.covariance), 0.0))
        deviation = dict(zip(longer.base.names, deviations.tolist(), strict=True))
        for i, cylinder in enumerate(self.base.model.robot.cylinders):
            name = f"{cylinder.name}.{INVERSE_BULK}"
            # Where gaps are many, a chamber may have no window that is so long.
            if name not in here or name not in there:
                continue
            # A spool that lags lets the delay run to its end: that is physics, and it is quick.
            if at_longest_delay(self.training, self.base.model, i):
                continue
            if there[name] - here[name] > _DEVIATIONS * deviation[name]:
                return True
        return False

    def _values(self) -> dict[str, float]:
        predictor = self.training.predictor
        values = predictor.parameters(self.base.model).tolist()
        return dict(zip(predictor.names, values, strict=True))


def settled(
    robot: Robot,
    forces: ForceModel,
    traces: Sequence[Trace],
    choices: Choices,
    still: Mapping[str, Mapping[int, Rest]],
    signals: SignalSurvey,
    split: HoldOut,
) -> Choices:
    """Choices with windows over which compliance no longer grows with their length.

    Parameters
    ----------
    robot, forces : Robot, ForceModel
    traces : sequence of Trace
        To look at.
    choices : Choices
        As the positions' noise and the commands ask for.
    still : mapping of str to mapping of int to Rest
        As `material_of`.
    signals : SignalSurvey
    split : HoldOut
        What is kept to verify on has no part in it.

    Returns
    -------
    Choices
        The same where nothing speaks against them.
    """
    step_s = max(t.step_s for t in traces)
    tried = [choices]
    for length_s in LENGTHS_S:
        hop_s = math.ceil(0.5 * length_s / step_s - 1e-9) * step_s
        if 2.0 * hop_s > choices.windows_s[0]:
            notes = (*choices.notes, _TEXT.format(2.0 * hop_s))
            tried.append(replace(choices, windows_s=(2.0 * hop_s, hop_s), notes=notes))
    known = [
        (one, balances)
        for one in tried
        if (balances := _balances(robot, forces, traces, one, still, signals, split)) is not None
    ]
    for k, (one, balances) in enumerate(known):
        if not any(balances.stiffer_than(longer) for _, longer in known[k + 1 :]):
            return one
    return choices


def _balances(
    robot: Robot,
    forces: ForceModel,
    traces: Sequence[Trace],
    choices: Choices,
    still: Mapping[str, Mapping[int, Rest]],
    signals: SignalSurvey,
    split: HoldOut,
) -> _Balances | None:
    windows = choices.windows(min(t.step_s for t in traces))
    material = material_of(
        robot, forces, traces, choices.filters, windows, still, choices.rest_speed,
        flows_alone=True,
    )  # fmt: skip
    rows = telling(material, signals) & material.masks(split)[0]
    if np.count_nonzero(rows) < _LEAST_ROWS * len(robot.cylinders):
        return None
    predictor = Predictor(material)
    training = Training.of(predictor, rows)
    begun = fit(training, start_model(robot, predictor, resolve(robot)))
    # On the way, oil takes up what a listed spool has not yet come to.
    return _Balances(training, settled_fit(training, begun))
