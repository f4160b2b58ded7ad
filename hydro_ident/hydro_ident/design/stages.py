"""The stages of an excitation run beside the Fourier motion.

Static poses approached from both sides (gravity apart from friction), slow ramps (the valve
around its null), a speed ladder (friction against speed) and chirps joint by joint (compression
of the oil, delay, inertia).
"""

from __future__ import annotations

import numpy as np

from hydro_ident.design.limits import half_range, natural_frequencies_hz
from hydro_ident.design.program import SIZES, Program, number, numbers
from hydro_ident.errors import IdentError
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.rigid_body import mass_matrix
from hydro_model.robot import FloatArray

#: Shares of the run's duration.
RAMPS, LADDER, CHIRPS = 0.04, 0.08, 0.04
_HOLD_S = 0.3
#: Travel past a pose and back, and of a slow ramp, over the half range of a joint.
_PAST, _CRAWL = 0.05, 0.06
_CHIRP_FROM_HZ, _CHIRP_TO_HZ = 0.3, 2.5
#: Torque that a chirp may take, as a share of the joint's limit; most of it in rad or m.
_CHIRP_EFFORT, _CHIRP_MOST = 0.12, 0.02


def add_static(program: Program, pose: FloatArray) -> None:
    """At rest in a pose, past it, and at rest in it again coming from the other side."""
    onward = np.where(pose >= program.at, 1.0, -1.0)
    program.move(pose)
    program.hold(_HOLD_S)
    for size in SIZES:
        past = pose + size * _PAST * onward * half_range(program.robot)
        trial = program.copy()
        try:
            trial.move(past)
            trial.move(pose)
        except IdentError:
            continue
        trial.hold(_HOLD_S)
        program.take(trial)
        return


def add_ramps(program: Program, duration_s: float) -> bool:
    """Out and back at a crawl, from where the program stands; whether that fits."""
    robot, at = program.robot, program.at
    travel = _CRAWL * half_range(robot) * np.where(at >= middle(robot), -1.0, 1.0)
    each = 0.5 * duration_s
    ends = (at + travel, at)
    return program.add(
        *(
            {
                "kind": "cruise",
                "to": numbers(end),
                "duration_s": number(each),
                "ramp_s": number(min(0.3, each / 4.0)),
            }
            for end in ends
        )
    )


def add_ladder(program: Program, duration_s: float) -> bool:
    """Out and back at full, half and quarter speed; whether any size of it fits.

    Neighbouring joints run against each other, so that the chain folds and stretches.
    """
    robot = program.robot
    program.move(middle(robot))
    turn = (-1.0) ** np.arange(robot.dof)
    speeds = np.array([joint.velocity_limit for joint in robot.joints]) * program.limits.speed
    ramp, hold = 0.03 * duration_s, 0.015 * duration_s
    cruising = duration_s - 6.0 * (ramp + hold)
    for size in SIZES:
        # All joints start and stop together: out and back three times at v, v / 2 and v / 4.
        travel = np.minimum(size * speeds * cruising / 14.0, 0.8 * half_range(robot)) * turn
        fastest = 14.0 * float(np.abs(travel).max()) / cruising
        ladder = {
            "kind": "ladder",
            "travel": numbers(travel),
            "speeds": [number(fastest / k) for k in (1.0, 2.0, 4.0)],
            "ramp_s": number(ramp),
            "hold_s": number(hold),
        }
        for sign in (1.0, -1.0):
            half_way = {
                "kind": "move",
                "to": numbers(program.at - 0.5 * sign * travel),
                "duration_s": number(max(1.0, 4.0 * ramp)),
            }
            if program.add(half_way, ladder | {"travel": numbers(sign * travel)}):
                return True
    return False


def _slowest_hz(program: Program) -> float:
    return float(natural_frequencies_hz(program.robot, program.at[None]).min(initial=np.inf))


def add_chirps(program: Program, duration_s: float) -> bool:
    """One joint after the other about the middle, as large as fits; whether all of them do."""
    robot = program.robot
    program.move(middle(robot))
    top = min(_CHIRP_TO_HZ, 0.7 * _slowest_hz(program))
    low = min(_CHIRP_FROM_HZ, 0.25 * top)
    inertia = np.diag(np.asarray(mass_matrix(robot, program.at)))
    each, fitted = duration_s / robot.dof, 0
    for j, joint in enumerate(robot.joints):
        largest = _CHIRP_EFFORT * joint.effort_limit / (inertia[j] * (2.0 * np.pi * top) ** 2)
        for size in SIZES:
            amplitude = np.zeros(robot.dof)
            amplitude[j] = size * min(largest, _CHIRP_MOST)
            chirp = {
                "kind": "chirp",
                "duration_s": number(each),
                "amplitude": numbers(amplitude),
                "from_hz": number(low),
                "to_hz": number(top),
                "ramp_s": number(each / 6.0),
            }
            if program.add(chirp):
                fitted += 1
                break
    return fitted == robot.dof
