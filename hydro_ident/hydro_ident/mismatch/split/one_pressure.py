"""Recordings that lack one pressure of a cylinder of which the fitted ones have both.

What was found with both pressures, a leak past the piston say, is no part of a balance that lacks
one: such a recording has none of that cylinder's rows, and its length is not to blame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.flows.chambers import Chamber, chambers_of
from hydro_ident.identify.survey import Survey
from hydro_ident.identify.verdict import BagLoss
from hydro_model.robot import Robot


def half_read(
    robot: Robot, fitted: Sequence[Survey], surveys: Sequence[Survey]
) -> tuple[BagLoss, ...]:
    """Balances that recordings lose for the other chamber's pressure.

    Parameters
    ----------
    robot : Robot
    fitted : sequence of Survey
        Of what is fitted.
    surveys : sequence of Survey
        Of the recordings that are looked at.
    """
    result = list[BagLoss]()
    for chamber in chambers_of(robot):
        other = "b" if chamber.side == "a" else "a"
        if not any(_read(s.recording, chamber, other) for s in fitted):
            continue
        result += [
            BagLoss(
                s.name,
                chamber.channel,
                f"no {chamber.cylinder.name}/{other} in /chamber_pressures, which what is fitted"
                " has: laws that were found with both pressures cannot be verified with one",
            )
            for s in surveys
            if _read(s.recording, chamber, chamber.side) and not _read(s.recording, chamber, other)
        ]
    return tuple(result)


def none_left(lost: Sequence[BagLoss]) -> str:
    """Why recordings to verify on have no row, for the pressures that they lack; empty for none.

    Parameters
    ----------
    lost : sequence of BagLoss
        Of them, as `half_read`.
    """
    if not lost:
        return ""
    reasons = ", ".join(dict.fromkeys(one.reason.partition(":")[0] for one in lost))
    return (
        f"{', '.join(dict.fromkeys(one.bag for one in lost))}: expected rows to verify on, found"
        f" none ({reasons}): record both pressures, or give no recording to verify on, and every"
        " fifth block of the others is kept for it"
    )


def _read(recording: Recording, chamber: Chamber, side: str) -> bool:
    """Whether a pressure of a chamber's cylinder was ever read."""
    pressures = recording.p_a if side == "a" else recording.p_b
    return pressures is not None and bool(np.isfinite(pressures[:, chamber.index]).any())
