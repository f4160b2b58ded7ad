"""The Fourier motion of a run: how many blocks, where, how long, and the way between them."""

from __future__ import annotations

import numpy as np

from hydro_ident.design.fourier import Blocks, FourierDesign, Spectrum, start_blocks
from hydro_ident.design.information import ForceInformation, moments
from hydro_ident.design.limits import natural_frequencies_hz
from hydro_ident.design.poses import CANDIDATES, short_order, static_poses
from hydro_ident.design.program import SIZES, Entry, Program, number, numbers
from hydro_ident.design.stages import add_static
from hydro_ident.errors import IdentError
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import FloatArray, Robot

#: Length of a Fourier block, s; the number of blocks follows from the run's duration.
_BLOCK_S, _MOST_BLOCKS = 14.0, 8
_HARMONICS, _WINDOW_S = 6, 1.0
#: Top of the Fourier motion: a controller follows well below the hydraulic mode only.
_TOP_HZ, _TOP_SHARE = 1.0, 0.3
_SHORTEST_BLOCK_S = 3.0
_STARTS = 3
#: Time kept for ways that grow longer as the poses move.
_SPARE_S = 0.5
#: Expected length of the way from one block to the next, rest included, and of the way back, s.
_BETWEEN_S, _RETURN_S = 5.0, 2.0
#: Spacing of the rows of the run so far.
_SPACING_S = 0.02


def optimised_blocks(
    program: Program,
    information: ForceInformation,
    start: FloatArray,
    duration_s: float,
    seed: int,
) -> Blocks:
    """Optimised blocks for what is left of the run, given what the run already tells.

    How long the ways between the blocks' poses take is known once there are poses: the length of
    the blocks is then set anew, and the optimiser goes on from there.

    Parameters
    ----------
    program : Program
        The run so far; not changed.
    information : ForceInformation
    start : (n,) array
        Where the run ends.
    duration_s : float
        Of the whole run.
    seed : int

    Returns
    -------
    Blocks

    Raises
    ------
    IdentError
        No block fits the limits, or the robot can stand nowhere within them.
    """
    robot, left = program.robot, duration_s - program.duration_s - _RETURN_S
    count = int(np.clip(round(left / (_BLOCK_S + _BETWEEN_S)), 2, _MOST_BLOCKS))
    spectrum = _spectrum(robot, count, left / count - _BETWEEN_S)
    told = _told(program, information)
    problem = FourierDesign(information, program.limits, spectrum, told)
    blocks = problem.best_of(_starts(problem, seed))
    trial = program.copy()
    played = visit_blocks(trial, blocks, start)
    length = blocks.duration_s + (duration_s - trial.duration_s - _SPARE_S) / played
    problem = FourierDesign(information, program.limits, _spectrum(robot, count, length), told)
    return problem.improved(blocks)


def _starts(problem: FourierDesign, seed: int) -> list[Blocks]:
    """First guesses about poses in which the robot can stand."""
    robot, spectrum = problem.robot, problem.spectrum
    found = []
    for one in (seed * _STARTS + k for k in range(_STARTS)):
        poses = static_poses(problem.information, problem.limits, spectrum.blocks, one)
        if len(poses):
            found.append(start_blocks(robot, spectrum, poses, one))
    if not found:
        raise IdentError(
            f"no motion fits the limits of robot {robot.name}: of {CANDIDATES} poses none does"
        )
    return found


def _spectrum(robot: Robot, count: int, length_s: float) -> Spectrum:
    length = number(max(length_s, _SHORTEST_BLOCK_S))
    modes = natural_frequencies_hz(robot, middle(robot)[None])
    top = min(_TOP_HZ, _TOP_SHARE * float(modes.min(initial=np.inf)))
    window = number(min(_WINDOW_S, length / 4.0))
    return Spectrum(count, _HARMONICS, number(top / _HARMONICS), length, window)


def _told(program: Program, information: ForceInformation) -> tuple[FloatArray, FloatArray]:
    """H and M of the run so far, as `FourierDesign` counts them: per second of motion."""
    segments = program.all_segments()
    path = JointPath(tuple(segments), joints=program.robot.joint_names)
    times = np.arange(0.0, path.duration_s, _SPACING_S)
    x = information.columns(*joint_motion(program.robot, path, times))
    bread, middle_part = moments(x, _SPACING_S, information.residual.correlation_s)
    return bread * _SPACING_S, middle_part * _SPACING_S**2


def visit_blocks(program: Program, blocks: Blocks, start: FloatArray) -> int:
    """Every block that can be reached and left again, and the way back; how many there are.

    Parameters
    ----------
    program : Program
        Grows by a static pose and a Fourier motion for every block.
    blocks : Blocks
    start : (n,) array
        Where the run ends.

    Returns
    -------
    int

    Raises
    ------
    IdentError
        None fits the limits.
    """
    visited = 0
    for index in short_order(program.at, blocks.centre):
        trial = program.copy()
        try:
            add_static(trial, np.array(numbers(blocks.centre[index])))
            if any(trial.add(_block(blocks, index, size)) for size in SIZES):
                trial.copy().move(start)
                program.take(trial)
                visited += 1
        except IdentError:
            continue
    if not visited:
        raise IdentError(
            f"no motion fits the limits of robot {program.robot.name}: no Fourier motion does"
        )
    program.move(start)
    return visited


def _block(blocks: Blocks, index: int, size: float) -> Entry:
    return {
        "kind": "fourier",
        "duration_s": number(blocks.duration_s),
        "fundamental_hz": number(blocks.fundamental_hz),
        "ramp_s": number(blocks.ramp_s),
        "sine": [numbers(row) for row in size * blocks.sine[index]],
        "cosine": [numbers(row) for row in size * blocks.cosine[index]],
    }
