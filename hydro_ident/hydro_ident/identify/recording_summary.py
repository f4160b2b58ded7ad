"""What was recorded, in figures: rates, gaps, ranges, irregularities, motion and tracking.

The part of a result that says whether the recordings themselves can be trusted and how much they
moved the machine; of long recordings, from their thinned first look.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.bag.gaps import LongestGap, longest_gap
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.recorded_with import Apart, RecordedWith, recorded_apart, recorded_with
from hydro_ident.errors import NotEnoughDataError
from hydro_ident.estimate.forces.standstill import least_travel
from hydro_ident.estimate.signals.derivatives import secant_slope
from hydro_ident.identify.survey import Survey
from hydro_ident.inspecting.health import Finding, find_irregularities
from hydro_ident.inspecting.inspection import Range, ranges_of
from hydro_ident.json_numbers import finite
from hydro_ident.recordings.metrics import ENCODER_HALF_WIDTH, Tracking, tracking
from hydro_model.robot import FloatArray

#: A joint moves beyond this share of its usual fast speed, which this share of time is below.
_MOVES, _USUAL = 0.1, 0.95
#: The speed that is given is not passed at this share of the time.
_FAST = 0.99


@dataclass(frozen=True, slots=True)
class JointMotion:
    """How a joint moved.

    Attributes
    ----------
    joint, unit : str
        `rad` or `m`.
    low, high : float
        Range that was visited.
    lower, upper : float
        The joint's limits; infinite where it has none.
    speed : float
        Not passed at 99 % of the time, unit per second.
    speed_limit : float
        0 where the robot file states none.
    moving_share : float
        Of the time; 0 of a joint that stands still throughout.
    reversals : int
        Changes of direction, rests in between or not.
    """

    joint: str
    unit: str
    low: float
    high: float
    lower: float
    upper: float
    speed: float
    speed_limit: float
    moving_share: float
    reversals: int

    def as_dict(self) -> dict[str, Any]:
        """For JSON; limits that a joint does not have are null."""
        return {**asdict(self), "lower": finite(self.lower), "upper": finite(self.upper)}


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """One recording.

    Attributes
    ----------
    name : str
    training : bool
        It was fitted (in part, where blocks of it were held out).
    duration_s, rate_hz : float
    thinned : int
        One cycle in so many was looked at here.
    gaps, missing : int
        Gaps, and cycles missing in them.
    longest_gap : LongestGap or None
        None without gaps.
    findings : tuple of Finding
        Irregular signals, and what lies between sensors and readings where that is another one
        than the first recording's.
    ranges : tuple of Range
    notes : tuple of str
    motion : tuple of JointMotion
        Of the joints whose position was recorded.
    tracking : Tracking or None
        Of the tip, from the encoders; None where no moving tip reference was recorded.
    time_s : (N,) array
    position, velocity : (N, n) array
        rad or m and per second; NaN where not recorded.
    recorded_with : tuple of RecordedWith
    """

    name: str
    training: bool
    duration_s: float
    rate_hz: float
    thinned: int
    gaps: int
    missing: int
    longest_gap: LongestGap | None
    findings: tuple[Finding, ...]
    ranges: tuple[Range, ...]
    notes: tuple[str, ...]
    motion: tuple[JointMotion, ...]
    tracking: Tracking | None
    time_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    recorded_with: tuple[RecordedWith, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The entry under `recordings` of a result file: everything but the samples."""
        return {
            "name": self.name,
            "training": self.training,
            "duration_s": self.duration_s,
            "rate_hz": self.rate_hz,
            "thinned": self.thinned,
            "gaps": self.gaps,
            "missing": self.missing,
            "longest_gap": None if self.longest_gap is None else asdict(self.longest_gap),
            "findings": [asdict(one) for one in self.findings],
            "ranges": [asdict(one) for one in self.ranges],
            "motion": [one.as_dict() for one in self.motion],
            "tracking": None if self.tracking is None else asdict(self.tracking),
            "recorded_with": {
                w.key: {"name": w.name, "sha256": w.sha256 or None} for w in self.recorded_with
            },
        }


def recording_summaries(surveys: Sequence[Survey], training: int) -> tuple[RecordingSummary, ...]:
    """Summaries of surveyed recordings.

    Parameters
    ----------
    surveys : sequence of Survey
    training : int
        So many of them, the first ones, were fitted.

    Returns
    -------
    tuple of RecordingSummary
    """
    apart = recorded_apart([(s.name, s.recording.metadata) for s in surveys])
    return tuple(
        _summary(s, k < training, [one for one in apart if one.bag == s.name])
        for k, s in enumerate(surveys)
    )


def _summary(survey: Survey, training: bool, apart: Sequence[Apart]) -> RecordingSummary:
    whole = survey.recording
    step_s = float(np.median(np.diff(whole.stamp_ns))) * 1e-9 if len(whole) > 1 else 0.0
    thinned = max(1, round(step_s / whole.period_s))
    # Durations are counted in samples: those of a thinned recording lie further apart.
    seen = replace(whole, period_s=whole.period_s * thinned)
    velocity = secant_slope(seen.time_s, seen.q)
    return RecordingSummary(
        name=survey.name,
        training=training,
        duration_s=survey.duration_s,
        rate_hz=1.0 / whole.period_s,
        thinned=thinned,
        gaps=len(whole.gaps),
        missing=sum(gap.missing for gap in whole.gaps),
        longest_gap=longest_gap(whole.gaps, int(whole.stamp_ns[0])) if len(whole) else None,
        findings=(
            *(Finding(one.key, "other", one.text) for one in apart),
            *find_irregularities(seen),
        ),
        ranges=tuple(ranges_of(seen)),
        notes=whole.notes,
        motion=_motion(seen, velocity),
        tracking=_tracking(seen, thinned),
        time_s=seen.time_s,
        position=seen.q,
        velocity=velocity,
        recorded_with=recorded_with(whole.metadata),
    )


def _motion(recording: Recording, velocity: FloatArray) -> tuple[JointMotion, ...]:
    found, least_travels = [], least_travel(recording.robot)
    for i, joint in enumerate(recording.robot.joints):
        q, v = recording.q[:, i], velocity[:, i]
        q, v = q[np.isfinite(q)], v[np.isfinite(v)]
        if not q.size or not v.size:
            continue
        least = _MOVES * float(np.quantile(np.abs(v), _USUAL))
        # The speeds of a joint at rest are its encoder's flicker.
        moving = (np.abs(v) > least) & (np.ptp(q) >= least_travels[i])
        # Signs of the moving samples alone: a rest between two ways does not hide a reversal.
        reversals = int(np.count_nonzero(np.diff(np.sign(v[moving]))))
        found.append(
            JointMotion(
                joint=joint.name,
                unit="m" if joint.prismatic else "rad",
                low=float(q.min()),
                high=float(q.max()),
                lower=joint.lower,
                upper=joint.upper,
                speed=float(np.quantile(np.abs(v), _FAST)),
                speed_limit=finite(joint.velocity_limit) or 0.0,
                moving_share=float(np.mean(moving)),
                reversals=reversals,
            )
        )
    return tuple(found)


def _tracking(recording: Recording, thinned: int) -> Tracking | None:
    """Figures of the tip; None where there is nothing to compare."""
    from hydro_model.multibody.kinematics import tip_position

    reference = recording.tip_ref
    if reference is None or not np.isfinite(reference).any():
        return None
    if bool(np.isnan(recording.q).all(axis=0).any()):
        return None
    width = max(1, round(ENCODER_HALF_WIDTH / thinned))
    tip = np.asarray(tip_position(recording.robot, recording.q))
    try:
        return tracking(recording.stamp_ns, tip, reference, half_width=width)
    except NotEnoughDataError:
        return None
