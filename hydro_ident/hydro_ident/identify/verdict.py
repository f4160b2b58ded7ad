"""What an identification amounts to: its verdict, what could not be had, and the run to have it.

A problem is a plain sentence that names the parameters it costs and what would give them. Nothing
here changes a number.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.flows.chambers import EDGES, INVERSE_BULK
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.forces.inertial import InertialFit, force_model
from hydro_ident.identify.continuity import Continuity, broken_up, partly_read
from hydro_ident.inspecting.mistaken_inputs import mistaken_rates
from hydro_ident.inspecting.mistaken_pressures import CONTRACT, mistaken_notes
from hydro_ident.robots.robot_ranges import cylinder_ranges
from hydro_ident.robots.robot_units import unit_errors
from hydro_model.description.robot_checks import LIMITS_SLACK
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import Robot

IDENTIFIED, PARTLY, NOT_ENOUGH = "identified", "partly_identified", "not_enough_data"

#: What the sentence about a bag that names another robot says.
RECORDED_AS = "was recorded as robot"
#: A recording with more than this share of its cycles outside a stroke is of another machine.
_OUTSIDE_SHARE = 0.05
#: A valve at its limit in more than this share of the cycles in which it is open says little.
_SATURATED_SHARE, _FULL, _OPEN = 0.25, 0.999, 0.02


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict with its reasons.

    Attributes
    ----------
    verdict : str
        `identified`, `partly_identified` or `not_enough_data`.
    problems : tuple of str
    """

    verdict: str
    problems: tuple[str, ...]

    def with_problem(self, text: str) -> Judgement:
        """With one more problem, which an empty text is not."""
        if not text:
            return self
        verdict = PARTLY if self.verdict == IDENTIFIED else self.verdict
        return Judgement(verdict, (*self.problems, text))


@dataclass(frozen=True, slots=True)
class BagLoss:
    """A channel that a bag does not give.

    Attributes
    ----------
    bag, channel, reason : str
    """

    bag: str
    channel: str
    reason: str


def losses_of(recordings: Sequence[Recording]) -> tuple[BagLoss, ...]:
    """Every channel that a recording does not give, bag by bag."""
    found = [
        BagLoss(recording.path.name, loss.channel, loss.reason)
        for recording in recordings
        for loss in recording.losses
    ]
    return tuple(dict.fromkeys(found))


def judge(
    robot: Robot,
    recordings: Sequence[Recording],
    inertial: InertialFit | None,
    hydraulic: HydraulicFit | None,
    continuities: Sequence[Continuity] = (),
    usable: str = "",
) -> Judgement:
    """The verdict of an identification.

    Parameters
    ----------
    robot : Robot
        As given.
    recordings : sequence of Recording
        Of the training.
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
        Both with the stages that were rejected.
    continuities : sequence of Continuity
        Of the recordings.
    usable : str
        What to ask for in the place of filters that were asked for, of `usable_filters`.

    Returns
    -------
    Judgement
    """
    # First of all: the likeliest reason of whatever else is wrong.
    others = [*mistaken_rates(recordings), *mistaken_notes(recordings)]
    others += recorded_as_others(recordings)
    wrong = wrong_robot(robot, recordings)
    if wrong:
        return Judgement(NOT_ENOUGH, (*others, *wrong))
    found, enough = _force_problems(robot, recordings, inertial, hydraulic, continuities, usable)
    problems = [*others, *found]
    if enough:
        problems += _hydraulic_problems(robot, inertial, hydraulic)
    problems += _saturated(robot, recordings, hydraulic)
    if not enough:
        return Judgement(NOT_ENOUGH, tuple(problems))
    return Judgement(PARTLY if problems else IDENTIFIED, tuple(problems))


def refused_numbers(found: Robot) -> list[str]:
    """Numbers of an identified robot that `check_robot` takes for another unit's.

    Parameters
    ----------
    found : Robot

    Returns
    -------
    list of str
        A sentence each. Edges that were found are rejected by then: these are the robot file's.
    """
    wrong = unit_errors(found, cylinder_ranges(found))
    return [f"the robot file's {about}: {text} (`check_robot`)" for about, text in wrong]


def spoils_all(text: str) -> bool:
    """Whether a sentence says that nothing of a recording holds of the machine.

    Parameters
    ----------
    text : str
        That it names another robot, that its pressures are in another unit, or anything else.
    """
    return RECORDED_AS in text or CONTRACT in text


def wrong_robot(robot: Robot, recordings: Sequence[Recording]) -> list[str]:
    """Recordings whose pistons would be outside their cylinders: of another machine.

    Parameters
    ----------
    robot : Robot
    recordings : sequence of Recording

    Returns
    -------
    list of str
        A sentence per recording and cylinder.
    """
    found = []
    for recording in recordings:
        for cylinder in robot.cylinders:
            q = recording.q[:, robot.joint_index(cylinder.joint)]
            q = q[np.isfinite(q)]
            x = stroke(cylinder, q)
            margin = LIMITS_SLACK * cylinder.stroke_m
            beyond = (x < -margin) | (x > cylinder.stroke_m + margin)
            if q.size and float(np.mean(beyond)) > _OUTSIDE_SHARE:
                found.append(
                    f"{recording.path.name} does not fit robot {robot.name}: {cylinder.joint} at"
                    f" {q.min():.3f} to {q.max():.3f} would put {cylinder.name} at"
                    f" {x.min():.3f} to {x.max():.3f} m, outside its stroke 0 to"
                    f" {cylinder.stroke_m:g} m; none of its parameters can be identified: give the"
                    " robot file of this machine, or correct the encoder's zero (calibrate)"
                )
    return found


def recorded_as_others(recordings: Iterable[Recording]) -> list[str]:
    """Recordings that name another robot.

    Parameters
    ----------
    recordings : iterable of Recording

    Returns
    -------
    list of str
        A sentence per recording.
    """
    said = (
        f"{r.path.name} {RECORDED_AS} '{r.other_robot}', not {r.robot.name}: every parameter is"
        " that of another machine unless both files describe the same one"
        for r in recordings
        if r.other_robot
    )
    return list(dict.fromkeys(said))


def _force_problems(
    robot: Robot,
    recordings: Sequence[Recording],
    inertial: InertialFit | None,
    hydraulic: HydraulicFit | None,
    continuities: Sequence[Continuity],
    usable: str,
) -> tuple[list[str], bool]:
    """Problems of the force channels, and whether there is enough for a model."""
    # Edges whose chambers tell no bulk modulus are of little motion.
    flows = hydraulic is not None and any(
        not c.rejected and c.refused_bulk is None and not c.unfitted for c in hydraulic.cylinders
    )
    if inertial is None:
        return [_no_forces(robot, recordings, continuities, usable)], flows
    if not inertial.missing:
        problems, enough = [], True
    else:
        lost = lost_forces(inertial, recordings)
        problems = [_motion_problem(robot, inertial, lost, continuities)]
        if lost and not inertial.still:
            enough = len(inertial.missing) < len(inertial.model.names) or flows
        else:
            base = [name for name in inertial.missing if name in inertial.model.base.names]
            enough = not (base or inertial.still)
    if inertial.rejected and enough:
        problems.append(
            "forces rejected, the robot file's base parameters, friction and listed effects of"
            f" friction kept: {inertial.rejected}"
        )
        # With nothing else identified there is no model to speak of.
        enough = flows
    return problems, enough


def _no_forces(
    robot: Robot,
    recordings: Sequence[Recording],
    continuities: Sequence[Continuity],
    usable: str,
) -> str:
    costs = f"{', '.join(force_model(robot).names)} cannot be identified"
    forces = {f"{joint}/{kind}" for joint in robot.joint_names for kind in ("force", "torque")}
    lost = [{loss.channel for loss in recording.losses} & forces for recording in recordings]
    measured = any(
        np.isfinite(r.q).any() and (r.p_a is not None or r.effort is not None) for r in recordings
    )
    if measured and (partial := partly_read(continuities)):
        return f"{partial[0]}: {costs}; {partial[1]}"
    if measured and not any(lost):
        total = sum(recording.duration_s for recording in recordings)
        if broken := broken_up(continuities, total):
            to_try = usable or "record without gaps (`inspect` lists them)"
            return f"{broken}: {costs}; {to_try}"
        to_try = usable or f"play a run of `excite --robot {robot.name}` and record it"
        return f"{total:.3g} s are too short for the filters: {costs}; {to_try}"
    return (
        f"no force channel: {costs}; record every joint angle and both chamber pressures of a"
        " cylinder (or a joint torque) for longer than the filters' edges"
    )


def lost_forces(inertial: InertialFit, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Force channels of the model that no recording gives."""
    lost = [{loss.channel for loss in recording.losses} for recording in recordings]
    return tuple(c for c in inertial.model.channels if lost and all(c in some for some in lost))


def _motion_problem(
    robot: Robot,
    inertial: InertialFit,
    lost: Sequence[str],
    continuities: Sequence[Continuity],
) -> str:
    text = f"the data do not determine {', '.join(inertial.missing)}"
    run = f"play a run of `excite --robot {robot.name}`"
    still = [robot.joint_names[j] for j in inertial.still]
    if still:
        names = ", ".join(still)
        return f"{text}: {names} did not move; drive every joint through its range, or {run}"
    if lost:
        return f"{text}: {', '.join(lost)} was not measured (see what was lost); record it, too"
    if partial := partly_read(continuities):
        return f"{text}: {'; '.join(partial)}"
    return f"{text}: too little motion; {run} and record it"


def _hydraulic_problems(
    robot: Robot, inertial: InertialFit | None, hydraulic: HydraulicFit | None
) -> list[str]:
    if not robot.valves:
        return []
    fitted = {c.cylinder: c for c in hydraulic.cylinders} if hydraulic else {}
    problems = []
    for valve in robot.valves:
        name = valve.cylinder
        if name not in fitted:
            problems.append(
                f"hydraulics of {name} rejected, the robot file's kept: no flow channel gave"
                f" enough windows, so that {name}.bulk_modulus and the edges of {valve.name}"
                " cannot be identified; record its valve voltage, both pressures and its position"
            )
        elif why := fitted[name].rejected:
            problems.append(f"hydraulics of {name} rejected, the robot file's kept: {why}")
            unknown = [
                column
                for column, known in zip(
                    fitted[name].names, fitted[name].identifiable, strict=True
                )
                if not known
            ]
            problems[-1] += _missing_run(unknown)
        elif (bulk := fitted[name].refused_bulk) is not None:
            problems.append(
                f"{name}.bulk_modulus rejected, the robot file's kept beside the edges as fitted:"
                f" {bulk.reason}"
            )
            problems[-1] += "" if bulk.told else _missing_run((INVERSE_BULK,))
        problems += _one_chamber(robot, fitted.get(name))
    return problems


def _one_chamber(robot: Robot, fit: CylinderFit | None) -> list[str]:
    """What stays as given of a cylinder of which one chamber alone was fitted."""
    if fit is None or fit.rejected or not fit.unfitted:
        return []
    lost = [f"{fit.valve}.{edge}" for edge in EDGES[fit.unfitted]]
    told = [f"{fit.cylinder}.bulk_modulus and"] if fit.refused_bulk is None else []
    joint = robot.cylinder(fit.cylinder).joint
    return [
        f"{joint}/flow_{fit.unfitted} gave no or too few windows: {' and '.join(lost)} stay the"
        f" robot file's; {' '.join([*told, 'the other edges'])} are of one chamber alone"
    ]


def _missing_run(unknown: Sequence[str]) -> str:
    """The motion that would determine columns of a chamber balance."""
    runs = {
        "c_pa": "extend it",
        "c_bt": "extend it",
        "c_at": "retract it",
        "c_pb": "retract it",
        "inverse_bulk_modulus": "reverse it quickly (chirps)",
    }
    wanted = list(dict.fromkeys(runs[name] for name in unknown if name in runs))
    return f"; to tell them, {' and '.join(wanted)} as a run of `excite` does" if wanted else ""


def _saturated(
    robot: Robot, recordings: Sequence[Recording], hydraulic: HydraulicFit | None
) -> list[str]:
    """Valves at their limit for long, with what that leaves undetermined."""
    problems = []
    fitted = {c.cylinder: c for c in hydraulic.cylinders} if hydraulic else {}
    for k, valve in enumerate(robot.valves):
        given = [r.valve_v[:, k] for r in recordings if r.valve_v is not None]
        signal = np.abs(np.concatenate(given)) / valve.rated_voltage_v if given else np.zeros(0)
        opened = signal > _OPEN
        if not opened.any() or float(np.mean(signal[opened] >= _FULL)) < _SATURATED_SHARE:
            continue
        fit = fitted.get(valve.cylinder)
        pairs = zip(fit.names, fit.identifiable, strict=True) if fit is not None else ()
        lost = [f"{valve.name}.{name}" for name, known in pairs if not known]
        lost += [f"the opening curve of {valve.name} (its edges hold at full opening only)"]
        problems.append(
            f"{valve.name} stood at its {valve.rated_voltage_v:g} V limit in"
            f" {float(np.mean(signal[opened] >= _FULL)):.0%} of the cycles in which it was open:"
            f" the data do not determine {', '.join(lost)}; repeat at half the speed, or play a"
            f" run of `excite --robot {robot.name}`"
        )
    return problems
