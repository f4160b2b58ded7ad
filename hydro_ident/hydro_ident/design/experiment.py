"""A sound experiment for a robot: path files that the controller plays.

Slow Fourier motion alone is badly conditioned. The run mixes static poses approached from both
sides (gravity apart from friction), slow ramps (the valve around its null), a speed ladder
(friction against speed), Fourier motion about several poses whose coefficients are optimised for
the smallest standard errors (inertia, first moments), and chirps joint by joint (bulk modulus,
delay). Every piece keeps the limits of joints, strokes, speeds, forces and valves' flow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from hydro_ident.design.fourier_stage import optimised_blocks, visit_blocks
from hydro_ident.design.information import ForceInformation, Residual
from hydro_ident.design.limits import Limits, half_range, margins
from hydro_ident.design.prediction import Prediction, predict
from hydro_ident.design.program import SIZES, Entry, Program, number, numbers
from hydro_ident.design.stages import (
    CHIRPS,
    LADDER,
    RAMPS,
    add_chirps,
    add_ladder,
    add_ramps,
)
from hydro_ident.errors import IdentError
from hydro_model.command_line.terminal import advance
from hydro_model.errors import RobotError
from hydro_model.motion.paths import JointPath, TipPath, load_path, shipped_paths
from hydro_model.motion.paths_check import PathCheck, check_path
from hydro_model.motion.paths_joints import joint_motion, joints_at_tip
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import FloatArray, Robot


class _BeyondLimitsError(IdentError):
    """A finished path exceeds what its pieces keep at their samples."""


LIMITS = Limits()
SHORTEST_S = 30.0
#: How far over the design's own limit of flow, which its pieces keep at their samples, a finished
#: path may come at samples that lie between these.
_BETWEEN = 1.01
#: Shares of the limit of flow that the pieces are made to, until the finished path keeps it: where
#: a quick chirp peaks, their samples are too few.
_FLOW_SHARES = (1.0, 0.97, 0.94, 0.9)
#: Of the validation run: deflection from the middle over the range, and the most of an angle.
_VALIDATION_SHARE, _VALIDATION_RAD, _VALIDATION_HARMONICS = 0.28, 0.5, 5
_VALIDATION_CANDIDATES = 8


@dataclass(frozen=True, slots=True)
class Design:
    """A designed path.

    Attributes
    ----------
    content : dict
        Of the path file.
    path : JointPath
    check : PathCheck
        Ranges, speeds and shares of the valves' flow.
    prediction : Prediction
        Standard errors that identification from this run alone is expected to have.
    left_out : tuple of str
        Stages that do not fit the robot's limits in any size.
    """

    content: dict[str, Any]
    path: JointPath
    check: PathCheck
    prediction: Prediction
    left_out: tuple[str, ...] = ()


#: Of the design of both runs, as `advance` counts them.
DESIGN_STAGES = 5


def start_pose(robot: Robot, tip_m: FloatArray | None = None) -> FloatArray:
    """Joint positions at the start of a run.

    Parameters
    ----------
    robot : Robot
    tip_m : (3,) array, optional
        Default: the first corner of the path shipped with the robot, or the middle of the
        joints' ranges.

    Returns
    -------
    (n,) array

    Raises
    ------
    RobotError
        The tip cannot be put there.
    """
    if tip_m is None:
        shipped = shipped_paths().get(f"{robot.name}/parallelogram")
        if shipped is None:
            return middle(robot)
        corner = load_path(shipped)
        if not isinstance(corner, TipPath):
            return middle(robot)
        tip_m = corner.sample(0.0)[0]
    return joints_at_tip(robot, np.asarray(tip_m, dtype=float))


def design_excitation(
    robot: Robot,
    start: FloatArray,
    duration_s: float,
    folder: Path,
    *,
    residual: Residual | None = None,
    seed: int = 0,
) -> Design:
    """Design the run to identify from.

    Parameters
    ----------
    robot : Robot
    start : (n,) array
        Where the run starts and ends, at rest.
    duration_s : float
        Wanted length; the design keeps to it within some seconds.
    folder : Path
        A folder for the file that is checked, removed by the caller.
    residual : Residual, optional
        What the model is expected to leave unexplained.
    seed : int
        Of the poses to choose from and of the optimiser's start.

    Returns
    -------
    Design

    Raises
    ------
    IdentError
        The duration is too short, a joint has no limit of its speed, one without
        cylinder none of its effort, or no motion fits the
        robot's limits.
    """
    if not duration_s >= SHORTEST_S:
        raise IdentError(f"expected a duration of {SHORTEST_S:g} s or more, found {duration_s:g}")
    endless = [joint.name for joint in robot.joints if not np.isfinite(joint.velocity_limit)]
    if endless:
        raise IdentError(
            f"no motion is as fast as robot {robot.name} can be: expected a velocity in the"
            f" URDF's <limit> of every joint, found none of {', '.join(endless)}"
        )
    joints = [robot.joints[j] for j in robot.dry_joints]
    endless = [joint.name for joint in joints if not np.isfinite(joint.effort_limit)]
    if endless:
        raise IdentError(
            f"no motion is as hard as robot {robot.name} can be: expected an effort above 0 in"
            f" the URDF's <limit> of joints without cylinder, found none of {', '.join(endless)}"
        )
    for share in _FLOW_SHARES[:-1]:
        limits = replace(LIMITS, flow=share * LIMITS.flow)
        try:
            return _excitation(robot, limits, start, duration_s, folder, residual, seed)
        except _BeyondLimitsError:
            continue
    limits = replace(LIMITS, flow=_FLOW_SHARES[-1] * LIMITS.flow)
    return _excitation(robot, limits, start, duration_s, folder, residual, seed)


def _excitation(
    robot: Robot,
    limits: Limits,
    start: FloatArray,
    duration_s: float,
    folder: Path,
    residual: Residual | None,
    seed: int,
) -> Design:
    residual = residual or Residual()
    information = ForceInformation(robot, residual)
    advance("ramps, speeds and chirps", 0, DESIGN_STAGES)
    program = Program(robot, limits, start)
    stages = {
        "slow ramps": add_ramps(program, RAMPS * duration_s),
        "speed ladder": add_ladder(program, LADDER * duration_s),
        "chirps": add_chirps(program, CHIRPS * duration_s),
    }
    advance("optimising the motions", 1, DESIGN_STAGES)
    blocks = optimised_blocks(program, information, np.asarray(start), duration_s, seed)
    advance("fitting them into the limits", 2, DESIGN_STAGES)
    played = visit_blocks(program, blocks, np.asarray(start))
    program.hold(duration_s - program.duration_s)
    left_out = [name for name, added in stages.items() if not added]
    if played < len(blocks.centre):
        left_out.append(f"{len(blocks.centre) - played} of {len(blocks.centre)} Fourier motions")
    advance("predicting errors", 3, DESIGN_STAGES)
    return _designed(robot, program.content(), folder, residual, tuple(left_out))


def design_validation(
    robot: Robot,
    start: FloatArray,
    duration_s: float,
    folder: Path,
    *,
    residual: Residual | None = None,
    seed: int = 0,
) -> Design:
    """Design another motion, to score predictions on: point to point, then a Fourier motion.

    Nothing of it is optimised: moves and phases follow from the seed alone, the size from the
    limits. Parameters and errors as `design_excitation`.

    `start` (n,) is the pose in which it begins.
    """
    size = _VALIDATION_SHARE * 2.0 * half_range(robot)
    capped = np.where([j.prismatic for j in robot.joints], size, np.minimum(size, _VALIDATION_RAD))
    for scale in SIZES:
        for candidate in range(_VALIDATION_CANDIDATES):
            rng = np.random.default_rng([seed, candidate])
            phases = rng.uniform(0.0, 2.0 * np.pi, (robot.dof, _VALIDATION_HARMONICS))
            program = Program(robot, LIMITS, start)
            if program.add(*_validation(robot, scale * capped, phases, duration_s)):
                program.move(np.asarray(start), at_least_s=duration_s * 0.10)
                return _designed(robot, program.content(), folder, residual or Residual())
    raise IdentError(
        f"no motion fits the limits of robot {robot.name}: moves of"
        f" {duration_s * 0.1:.1f} s about the middle exceed them in every size"
    )


def _validation(
    robot: Robot, amplitude: FloatArray, phases: FloatArray, duration_s: float
) -> list[Entry]:
    """Four moves about the middle, back to it, and a Fourier motion."""
    centre, turn = middle(robot), 2.0 * np.arange(robot.dof)
    targets = [centre + amplitude * np.cos(0.9 * k + turn) for k in range(4)]
    moves = [_quintic(target, duration_s * 0.11) for target in targets]
    return [
        *moves,
        _quintic(centre, duration_s * 0.10),
        _random_fourier(amplitude, phases, duration_s * 0.36),
    ]


def _designed(
    robot: Robot,
    content: dict[str, Any],
    folder: Path,
    residual: Residual,
    left_out: tuple[str, ...] = (),
) -> Design:
    """Read the path back from its file, check it as the controller will, and predict."""
    file = folder / "candidate.yaml"
    file.write_text(path_text(content), encoding="utf-8")
    path = cast(JointPath, load_path(file))
    try:
        kept, most = margins(robot, LIMITS), _BETWEEN * LIMITS.flow
        check = check_path(robot, path, margin=kept, flow_limit=most)
    except RobotError as error:
        raise _BeyondLimitsError(
            f"no motion fits the limits of robot {robot.name}: {error}"
        ) from error
    step = 1.0 / robot.sensors.rate_hz
    motion = joint_motion(robot, path, np.arange(0.0, path.duration_s, step))
    return Design(content, path, check, predict(robot, motion, residual, step), left_out)


def path_text(content: dict[str, Any], comment: str = "") -> str:
    """A path file as text.

    `content` is what the YAML file holds.
    """
    head = f"# {comment}\n" if comment else ""
    return head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=99)


def _quintic(target: FloatArray, duration_s: float) -> Entry:
    return {"kind": "move", "to": numbers(target), "duration_s": number(duration_s)}


def _random_fourier(amplitude: FloatArray, phases: FloatArray, duration_s: float) -> Entry:
    """Harmonics whose amplitudes fall with their number; the sum stays within `amplitude`."""
    weights = 1.0 / np.arange(1, phases.shape[1] + 1) ** 1.3
    sizes = 0.9 * amplitude[:, None] * weights / weights.sum()
    return {
        "kind": "fourier",
        "duration_s": number(duration_s),
        "fundamental_hz": number(2.0 / duration_s),
        "ramp_s": number(min(2.0, duration_s / 6.0)),
        "sine": [numbers(row) for row in sizes * np.cos(phases)],
        "cosine": [numbers(row) for row in sizes * np.sin(phases)],
    }
