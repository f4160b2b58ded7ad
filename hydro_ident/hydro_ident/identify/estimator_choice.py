"""Which estimator a recording asks for: the rule of `--estimator auto`.

1. Samples that stand out: `robust`. Few of them, of which any estimator leaves out those that are
   gross, are no reason for it.
2. Recorded references throughout, as instruments, move a parameter by much more than chance:
   `iv`.
3. Else `wls`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.forces.inertial import InertialFit, parameter_scales
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.watched import SPIKE_SIGMAS, watched_sensors
from hydro_ident.estimate.statistics.least_squares import BoolArray, Estimator
from hydro_ident.identify.survey import Survey
from hydro_model.robot import FloatArray, Robot

#: What may be asked for.
Choice = Literal["auto", "ols", "wls", "robust", "iv"]
#: `auto`: more spikes than this share call for the robust estimator.
SPIKE_SHARE = 1.0e-3
#: `auto`: references over this share of the time serve as instruments.
REFERENCED_SHARE = 0.95
#: `auto`: instruments are used where a parameter moves by more than so many deviations of the
#: difference (Durbin, Wu, Hausman), and none becomes less certain by more than this factor.
HAUSMAN_SIGMAS, WEAKEST = 4.0, 3.0
#: Smaller shares of what a parameter could be at most are the filters' own, however significant.
LEAST_CHANGE = 0.003


@dataclass(frozen=True, slots=True)
class Chosen:
    """The estimator that was used, and why.

    Attributes
    ----------
    name : {"ols", "wls", "robust", "iv"}
        Of the force channels; the chambers' balances, which nothing is differentiated in, take
        `wls` where that says `iv`.
    reason : str
    """

    name: Estimator
    reason: str


def referenced_share(surveys: Sequence[Survey]) -> float:
    """Share of the time in which the joint references were recorded."""
    total = sum(s.usable_s for s in surveys)
    return sum(s.referenced_s for s in surveys) / total if total > 0.0 else 0.0


def first_choice(
    choice: Choice, robot: Robot, surveys: Sequence[Survey], signals: SignalSurvey
) -> Chosen:
    """The estimator as far as it can be told before anything is fitted.

    Raises
    ------
    IdentError
        Instruments without recorded references.
    """
    if choice == "iv" and referenced_share(surveys) < REFERENCED_SHARE:
        raise IdentError(
            "--estimator iv needs the joint references as instruments: expected /joint_reference"
            f" over {REFERENCED_SHARE:.0%} of the recordings, found"
            f" {referenced_share(surveys):.0%}"
        )
    if choice != "auto":
        return Chosen(choice, "asked for")
    name, share = worst_sensor(robot, signals)
    if share > SPIKE_SHARE:
        return Chosen(
            "robust",
            f"{share:.2%} of the samples of {name} stand out by more than {SPIKE_SIGMAS:g}"
            " standard deviations",
        )
    few = "few" if share else "no"
    return Chosen("wls", f"{few} outliers, and no recorded references to check against")


def worst_sensor(robot: Robot, signals: SignalSurvey) -> tuple[str, float]:
    """The sensor with the largest share of spikes, and that share."""
    shares = {sensor.name: sensor.spikes for sensor in watched_sensors(robot, signals)}
    name = max(shares, key=lambda n: shares[n], default="")
    return name, shares.get(name, 0.0)


def compared(wls: InertialFit, iv: InertialFit | None) -> Chosen:
    """Whether instruments tell anything that least squares does not: Durbin, Wu and Hausman.

    The two estimates differ by sampling alone unless the regressors carry noise. The deviation of
    their difference is taken as ``sqrt(std_iv^2 - std_wls^2)``, not below a tenth of `std_iv`.
    That is exact only where least squares are efficient, which they are not under autocorrelated
    noise; the true one is bounded by ``|std_iv - std_wls|`` and ``std_iv + std_wls``, as the value
    taken is. `HAUSMAN_SIGMAS` is therefore a threshold that leaves room, no level of significance.
    """
    if iv is None:
        return Chosen("wls", "too few rows with references to check against")
    known = np.array(wls.identifiable) & np.array(iv.identifiable)
    a, b = wls.fit, iv.fit
    weaker = np.max(b.std[known] / a.std[known], initial=0.0)
    spread = np.sqrt(np.maximum(b.std**2 - a.std**2, (0.1 * b.std) ** 2))
    change = np.abs(b.theta - a.theta)
    scales = parameter_scales(wls.model, a.theta, a.std)
    least = LEAST_CHANGE * np.where(np.isfinite(scales), scales, np.abs(b.theta))
    if not known.any() or weaker > WEAKEST:
        return Chosen("wls", "the recorded references are too weak as instruments")
    ratio = np.where(known, change / np.where(spread > 0.0, spread, np.inf), 0.0)
    return _by_change(wls.model.names, ratio, change > least)


def _by_change(names: Sequence[str], ratio: FloatArray, large: BoolArray) -> Chosen:
    """The rule on the changes, in deviations, of which some are large enough to matter."""
    most = int(np.argmax(np.where(large, ratio, 0.0)))
    if large[most] and ratio[most] > HAUSMAN_SIGMAS:
        return Chosen(
            "iv",
            f"instruments move {names[most]} by {ratio[most]:.1f} standard deviations: noise of"
            " the derivatives biases least squares",
        )
    most = int(np.argmax(ratio))
    text = "the recorded references as instruments give the same"
    found = f"{names[most]} moves most, by {ratio[most]:.1f} standard deviations"
    if ratio[most] <= HAUSMAN_SIGMAS:
        return Chosen("wls", f"{text} within {HAUSMAN_SIGMAS:g} standard deviations ({found})")
    small = f"less than {LEAST_CHANGE:.1%} of what it could be at most"
    return Chosen("wls", f"{text} as far as it matters ({found}, but {small})")
