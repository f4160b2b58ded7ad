"""Errors of position sensors taken out of the recordings, and what was told of them before."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from hydro_ident.errors import NotEnoughDataError
from hydro_ident.mismatch.answer.answering import Answer, answered, base_to_search
from hydro_ident.mismatch.answer.off_centre import off_centre
from hydro_ident.mismatch.rows.off_centre import OffCentre
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.unnamed.unknown import HINT, TakenOut, Unexplained
from hydro_model.robot import Robot

#: What a reading's error depends on, whatever it had been seen to follow, in channels of its own
#: joint and of others.
_OF_ITS_OWN, _OF_OTHERS = ("joint_angle", "piston_velocity"), ("other_joint",)
#: Waves that are taken out of one sensor at most, one after the other.
_ROUNDS = 3


def without_off_centre(
    held: list[Answer], lay: Callable[[Sequence[OffCentre]], Residuals | None]
) -> Answer:
    """What is found without the errors of position sensors, where there are any.

    Parameters
    ----------
    held : list of Answer
        The first one, and no more. It is taken out of the list, as its rows are as large as those
        of the next, and nobody else should keep them.
    lay : callable
        Rows and base of the same recordings without such errors; None where none are left.

    Returns
    -------
    Answer
        With what had no name before as well, and that a sensor's error was it.
    """
    told, sizes = dict[str, Unexplained](), dict[str, tuple[float, float]]()
    robot = held[0].work.robot
    for _ in range(_ROUNDS):
        found = off_centre(held[0])
        if not found.errors:
            break
        for name, (before, after) in found.sizes.items():
            sizes[name] = sizes.get(name, (before, after))[0], after
        # Of two entries of a channel the first is what follows a variable.
        told = {one.channel: one for one in reversed(held[0].unknown)} | told
        errors = (*held[0].work.off, *found.errors)
        held.clear()
        work = lay(errors)
        if work is None:
            raise NotEnoughDataError(
                f"expected rows without what {off_words(robot, errors)} makes, found none"
            )
        held.append(answered(work, base_to_search(work)))
        del work
    answer = held.pop()
    return replace(answer, unknown=_with_told(answer, told, sizes)) if told else answer


def _with_told(
    answer: Answer,
    told: Mapping[str, Unexplained],
    sizes: Mapping[str, tuple[float, float]],
) -> tuple[Unexplained, ...]:
    """What has no name, and what had none until errors of sensors were taken out."""
    robot, left = answer.work.robot, {one.channel for one in answer.unknown}
    because = off_words(robot, answer.work.off)
    owners = {robot.joint_names[error.joint] for error in answer.work.off}
    gone = [
        replace(
            one,
            depends_on=_OF_ITS_OWN if one.channel.split("/")[0] in owners else _OF_OTHERS,
            text=f"{one.text.removesuffix(f'; {HINT}')}; {because}",
            taken_out=TakenOut(because, *sizes.get(one.channel, (math.nan, math.nan))),
        )
        for name, one in told.items()
        if name not in left
    ]
    order = {name: k for k, name in enumerate(answer.work.training.predictor.material.channels)}
    found = sorted((*answer.unknown, *gone), key=lambda one: order.get(one.channel, len(order)))
    return tuple(found)


def off_words(robot: Robot, errors: Sequence[OffCentre]) -> str:
    """Errors of position sensors, in words.

    Parameters
    ----------
    robot : Robot
    errors : sequence of OffCentre
    """
    said = []
    for one in errors:
        joint = robot.joints[one.joint]
        unit = "m" if joint.prismatic else "rad"
        said.append(
            f"the position of {joint.name} is read off by"
            f" {1e3 * one.amplitude:.3g} +- {1e3 * one.std:.2g} m{unit} either way"
            f" every {one.period:.4g} {unit}, as by a sensor off its centre"
        )
    return " and ".join(said)


def off_notes(work: Residuals) -> list[str]:
    """What was taken out of the recordings, in words.

    Parameters
    ----------
    work : Residuals
    """
    if not work.off:
        return []
    return [
        f"{off_words(work.robot, work.off)}: taken out of the recordings, before and after alike;"
        " not in the model"
    ]
