"""Which estimator a recording asks for: the rule of `--estimator auto`.

1. Samples that stand out: `robust`.
2. Recorded references throughout, as instruments, move a parameter by much more than chance:
   `iv`.
3. Else `wls`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hydro_ident.cleaning import PRESSURE_SHARE, SPIKE_SIGMAS
from hydro_ident.errors import IdentError
from hydro_ident.estimate.inertial import InertialFit, parameter_scales
from hydro_ident.estimate.least_squares import Estimator
from hydro_ident.estimate.signal_survey import SignalSurvey
from hydro_ident.survey import Survey
from hydro_model.robot import Robot

#: What may be asked for.
Choice = Literal["auto", "ols", "wls", "robust", "iv"]
CHOICES: tuple[Choice, ...] = ("auto", "ols", "wls", "robust", "iv")
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
    return Chosen("wls", "no outliers, and no recorded references to check against")


def worst_sensor(robot: Robot, signals: SignalSurvey) -> tuple[str, float]:
    """The sensor with the largest share of spikes, and that share."""
    floor = PRESSURE_SHARE * robot.supply_pressure_pa
    count = 2.0 * np.pi / robot.sensors.encoder_counts_per_rev
    bar = robot.sensors.pressure_resolution_pa
    shares = {
        n: s.spikes(count, SPIKE_SIGMAS) for n, s in zip(robot.joint_names, signals.q, strict=True)
    }
    for side, sensors in (("a", signals.p_a), ("b", signals.p_b)):
        for cylinder, sensor in zip(robot.cylinders, sensors, strict=True):
            shares[f"{cylinder.name}/{side}"] = sensor.spikes(bar, SPIKE_SIGMAS, floor)
    name = max(shares, key=lambda n: shares[n])
    return name, shares[name]


def compared(wls: InertialFit, iv: InertialFit | None) -> Chosen:
    """Whether instruments tell anything that least squares does not: Durbin, Wu and Hausman.

    The two estimates differ by sampling alone unless the regressors carry noise; the variance of
    their difference is then the difference of their variances.
    """
    if iv is None:
        return Chosen("wls", "too few rows with references to check against")
    known = np.array(wls.identifiable) & np.array(iv.identifiable)
    a, b = wls.fit, iv.fit
    weaker = np.max(b.std[known] / a.std[known], initial=0.0)
    spread = np.sqrt(np.maximum(b.std**2 - a.std**2, (0.1 * b.std) ** 2))
    change = np.abs(b.theta - a.theta)
    scales = parameter_scales(wls.model)
    least = LEAST_CHANGE * np.where(np.isfinite(scales), scales, np.abs(b.theta))
    moved = np.where(change > least, change, 0.0)
    moved = (moved / np.where(spread > 0.0, spread, np.inf))[known]
    largest = float(np.max(moved, initial=0.0))
    if not known.any() or weaker > WEAKEST:
        return Chosen("wls", "the recorded references are too weak as instruments")
    if largest <= HAUSMAN_SIGMAS:
        text = "the recorded references as instruments give the same within"
        return Chosen("wls", f"{text} {HAUSMAN_SIGMAS:g} standard deviations ({largest:.1f})")
    name = np.array(wls.model.names)[known][int(np.argmax(moved))]
    return Chosen(
        "iv",
        f"instruments move {name} by {largest:.1f} standard deviations: noise of the derivatives"
        " biases least squares",
    )
