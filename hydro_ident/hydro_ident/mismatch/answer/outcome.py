"""What a diagnosis comes to: verdict, findings, channels before and after."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_ident.identify.recording_summary import RecordingSummary
from hydro_ident.identify.verdict import BagLoss
from hydro_ident.mismatch.answer.not_testable import NotTestable
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.modelling.refinement import Refinement
from hydro_ident.mismatch.naming.named import Named
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.mismatch.verifying.verify import Verification
from hydro_ident.rollouts.free_run import FreeRun
from hydro_model.robot import FloatArray, Robot

MATCHES, EXPLAINED, PARTLY = "matches", "explained", "partly_explained"
UNKNOWN, NO_IMPROVEMENT, NOT_ENOUGH = "unknown", "no_improvement", "not_enough_data"
#: How far from its sensors' noise a channel is at most of which next to nothing else is left.
_AT_NOISE = 1.25


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """A named cause with what held-out rows say of it.

    Attributes
    ----------
    named : Named
    verification : Verification
    channels : tuple of str
        Where it shows, strongest first.
    """

    named: Named
    verification: Verification
    channels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ChannelResult:
    """A channel on rows that took no part, or on those that did.

    Attributes
    ----------
    name, unit : str
    time_s, measured, before, after : (T,) array
        Measured values, and what the base and the final model predict.
    noise_floor : float
    """

    name: str
    unit: str
    time_s: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    noise_floor: float

    @property
    def at_noise(self) -> bool:
        """Whether next to nothing but the sensors' noise is left."""
        return rms(self.measured - self.after) <= _AT_NOISE * self.noise_floor


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """What a diagnosis found.

    Attributes
    ----------
    verdict : str
    given : Robot
    robot : Robot or None
        With the findings; None with the verdict `not_enough_data`.
    findings : tuple of Finding
    rejected : tuple of Finding
        Named, but not confirmed.
    unexplained : tuple of Unexplained
    not_testable : tuple of NotTestable
    channels : tuple of ChannelResult
    located : tuple of Dependence
        Of the base model's residual, strongest first.
    free_run : FreeRun or None
    problems, notes : tuple of str
    losses : tuple of BagLoss
    work : Residuals or None
    whole : Fitted or None
        The final model on the training rows.
    fitted : tuple of ChannelResult
        As `channels`, on the training rows.
    recordings : tuple of RecordingSummary
    refinement : Refinement or None
        By roll-outs, where it was asked for.
    reservations : tuple of str
        Why findings explain but partly, beside what is unexplained or not exercised.
    """

    verdict: str
    given: Robot
    robot: Robot | None
    findings: tuple[Finding, ...] = ()
    rejected: tuple[Finding, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    not_testable: tuple[NotTestable, ...] = ()
    channels: tuple[ChannelResult, ...] = ()
    located: tuple[Dependence, ...] = ()
    free_run: FreeRun | None = None
    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    losses: tuple[BagLoss, ...] = ()
    work: Residuals | None = None
    whole: Fitted | None = None
    fitted: tuple[ChannelResult, ...] = ()
    recordings: tuple[RecordingSummary, ...] = ()
    refinement: Refinement | None = None
    reservations: tuple[str, ...] = ()
