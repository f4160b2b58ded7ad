"""A sound experiment for a robot, designed by hand: path files that the controller plays.

Slow Fourier motion alone is badly conditioned. The run mixes static poses approached from both
sides (gravity apart from friction), slow ramps (the valve around its null), a speed ladder
(friction against speed), a Fourier motion of all joints (inertia) and chirps joint by joint (bulk
modulus, delay). Sizes follow from the robot's limits and shrink until the path fits them; the
phases of the Fourier motion are the best conditioned of a fixed set of candidates.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from hydro_ident.errors import IdentError
from hydro_model.base_parameters import base_map
from hydro_model.cylinder import lever
from hydro_model.errors import RobotError
from hydro_model.paths import JointPath, TipPath, load_path, shipped_paths
from hydro_model.paths_check import PathCheck, check_path, joint_motion, joints_at_tip
from hydro_model.rigid_body import mass_matrix, regressor
from hydro_model.robot import FloatArray, Robot

#: Shares of the run's duration.
_STATIC, _RAMPS, _LADDER, _FOURIER, _CHIRPS = 0.17, 0.07, 0.25, 0.27, 0.10
#: Levels of the staircase, one way.
_LEVELS = 4
_HARMONICS = 5
_CANDIDATES = 16
_CHIRP_HZ = (0.3, 2.5)
#: Torque that a chirp may take, as a share of the joint's limit.
_CHIRP_EFFORT = 0.12
#: Share of the joint's range to either side of its middle, and the most of a revolute joint.
_AMPLITUDE_SHARE, _AMPLITUDE_RAD = 0.28, 0.5
#: Distance from the joint limits, and share of the valves' flow, that a design keeps.
MARGIN, FLOW_LIMIT = 0.05, 0.5
SHORTEST_S = 30.0
#: Spacing at which candidates are checked and judged.
_STEP_S = 0.04
_SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2)


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
    condition : float
        Condition number of the force regressor with columns of unit length.
    scale : float
        Size to which the motion was shrunk to fit the robot's limits.
    """

    content: dict[str, Any]
    path: JointPath
    check: PathCheck
    condition: float
    scale: float


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
            return _middle(robot)
        corner = load_path(shipped)
        if not isinstance(corner, TipPath):
            return _middle(robot)
        tip_m = corner.sample(0.0)[0]
    return joints_at_tip(robot, np.asarray(tip_m, dtype=float))


def design_excitation(robot: Robot, start: FloatArray, duration_s: float, folder: Path) -> Design:
    """Design the run to identify from.

    Parameters
    ----------
    robot : Robot
    start : (n,) array
        Where the run starts and ends, at rest.
    duration_s : float
        Wanted length; the design keeps to it within some seconds.
    folder : Path
        A folder for the files that are tried, removed by the caller.

    Returns
    -------
    Design

    Raises
    ------
    IdentError
        The duration is too short, or no size of motion fits the robot's limits.
    """
    if duration_s < SHORTEST_S:
        raise IdentError(f"expected a duration of {SHORTEST_S:g} s or more, found {duration_s:g}")

    def build(scale: float, phases: FloatArray) -> dict[str, Any]:
        return _excitation(robot, start, duration_s, scale, phases)

    return _best(robot, build, folder, range(_CANDIDATES))


def design_validation(robot: Robot, start: FloatArray, duration_s: float, folder: Path) -> Design:
    """Design another motion, to score predictions on: point to point, then a Fourier motion.

    Parameters and errors as `design_excitation`.
    """

    def build(scale: float, phases: FloatArray) -> dict[str, Any]:
        amplitude = scale * _amplitudes(robot)
        centre = _middle(robot)
        moves = [
            centre + amplitude * np.cos(0.9 * k + np.arange(robot.dof) * 2.0) for k in range(4)
        ]
        segments = [_move(target, duration_s * 0.11) for target in moves]
        segments.append(_move(centre, duration_s * 0.10))
        segments.append(_fourier(amplitude, phases, duration_s * 0.36))
        segments.append(_move(start, duration_s * 0.10))
        return _file(robot, start, segments)

    # Candidates that the excitation never tries: a different motion by construction.
    return _best(robot, build, folder, range(_CANDIDATES, _CANDIDATES + 4))


def _best(robot: Robot, build: Any, folder: Path, seeds: range) -> Design:
    """The best conditioned candidate at the largest size that all limits allow."""
    best: Design | None = None
    refusal = ""
    for seed in seeds:
        phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (robot.dof, _HARMONICS))
        for scale in _SCALES:
            if best is not None and scale < best.scale:
                break
            content = build(scale, phases)
            try:
                path, check = _checked(robot, content, folder)
            except RobotError as error:
                refusal = str(error)
                continue
            condition = condition_number(robot, path)
            if best is None or (scale, -condition) > (best.scale, -best.condition):
                best = Design(content, path, check, condition, scale)
            break
        if best is None:
            break  # Not even the smallest motion fits, whatever its phases.
    if best is None:
        raise IdentError(f"no motion fits the limits of robot {robot.name}: {refusal}")
    return best


def _checked(robot: Robot, content: dict[str, Any], folder: Path) -> tuple[JointPath, PathCheck]:
    file = folder / "candidate.yaml"
    file.write_text(path_text(content), encoding="utf-8")
    path = cast(JointPath, load_path(file))
    return path, check_path(robot, path, margin=MARGIN, flow_limit=FLOW_LIMIT, step_s=_STEP_S)


def path_text(content: dict[str, Any], comment: str = "") -> str:
    """A path file as text."""
    head = f"# {comment}\n" if comment else ""
    return head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=99)


def condition_number(robot: Robot, path: JointPath) -> float:
    """Condition number of base parameters with viscous friction along a path.

    Force rows (torque over lever) and columns of unit length, so that units do not matter.
    """
    times = np.arange(0.0, path.duration_s, _STEP_S)
    q, qd, qdd = joint_motion(robot, path, times)
    x = regressor(robot, q, qd, qdd)[..., list(base_map(robot).leading)]
    friction = np.zeros((*q.shape, len(robot.cylinders)))
    for i, cylinder in enumerate(robot.cylinders):
        at = robot.joint_index(cylinder.joint)
        arm = lever(cylinder, q[:, at])
        x[:, at] /= arm[:, None]
        friction[:, at, i] = arm * qd[:, at]
    columns = np.concatenate([x, friction], axis=2).reshape(-1, x.shape[2] + friction.shape[2])
    norms = np.linalg.norm(columns, axis=0)
    return float(np.linalg.cond(columns / np.where(norms > 0.0, norms, 1.0)))


def _middle(robot: Robot) -> FloatArray:
    return np.array([0.5 * (joint.lower + joint.upper) for joint in robot.joints])


def _amplitudes(robot: Robot) -> FloatArray:
    """Greatest deflection from the middle of the range, per joint."""
    sizes = []
    for joint in robot.joints:
        size = _AMPLITUDE_SHARE * (joint.upper - joint.lower)
        sizes.append(size if joint.prismatic else min(size, _AMPLITUDE_RAD))
    return np.array(sizes)


def _excitation(
    robot: Robot, start: FloatArray, duration_s: float, scale: float, phases: FloatArray
) -> dict[str, Any]:
    centre, amplitude = _middle(robot), scale * _amplitudes(robot)
    # Neighbouring joints run against each other, so that the chain folds and stretches.
    turn = (-1.0) ** np.arange(robot.dof)
    shares = np.linspace(-1.0, 1.0, _LEVELS)
    levels = [centre + s * turn * amplitude for s in (*shares, *shares[::-1])]
    step = _STATIC * duration_s / len(levels)
    segments: list[dict[str, Any]] = [
        _move(levels[0], 0.05 * duration_s),
        {
            "kind": "staircase",
            "levels": [_numbers(level) for level in levels],
            "move_s": _number(0.65 * step),
            "hold_s": _number(0.35 * step),
        },
        *_ramps(levels[0], turn * amplitude, _RAMPS * duration_s),
        _ladder(0.8 * turn * amplitude, _LADDER * duration_s),
        _move(centre, 0.04 * duration_s),
        _fourier(amplitude, phases, _FOURIER * duration_s),
        *_chirps(robot, centre, _CHIRPS * duration_s),
        _move(start, 0.06 * duration_s),
    ]
    return _file(robot, start, segments)


def _file(robot: Robot, start: FloatArray, segments: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "joints": list(robot.joint_names),
        "start": _numbers(start),
        "start_delay_s": 1.0,
        "segments": segments,
    }


def _number(value: float) -> float:
    """Rounded, so that a file reads well and is the same on every machine."""
    return round(float(value), 6)


def _numbers(values: FloatArray) -> list[float]:
    return [_number(value) for value in values]


def _move(target: FloatArray, duration_s: float) -> dict[str, Any]:
    return {"kind": "move", "to": _numbers(target), "duration_s": _number(duration_s)}


def _ramps(at: FloatArray, travel: FloatArray, duration_s: float) -> list[dict[str, Any]]:
    """Out and back at a crawl: a tenth of the travel either way."""
    ends = (at + 0.1 * travel, at)
    each = 0.5 * duration_s
    return [
        {
            "kind": "cruise",
            "to": _numbers(end),
            "duration_s": _number(each),
            "ramp_s": _number(min(0.3, each / 4.0)),
        }
        for end in ends
    ]


def _ladder(travel: FloatArray, duration_s: float) -> dict[str, Any]:
    """Out and back at one, two and three times a speed that fills the duration."""
    distance = float(np.abs(travel).max())
    ramp, hold = 0.05 * duration_s, 0.0125 * duration_s
    slowest = 2.0 * distance * (1.0 + 1.0 / 2.0 + 1.0 / 3.0) / (duration_s - 6.0 * (ramp + hold))
    return {
        "kind": "ladder",
        "travel": _numbers(travel),
        "speeds": [_number(slowest * factor) for factor in (1.0, 2.0, 3.0)],
        "ramp_s": _number(ramp),
        "hold_s": _number(hold),
    }


def _fourier(amplitude: FloatArray, phases: FloatArray, duration_s: float) -> dict[str, Any]:
    """Harmonics whose amplitudes fall with their number; the sum stays within `amplitude`."""
    weights = 1.0 / np.arange(1, _HARMONICS + 1) ** 1.3
    sizes = 0.9 * amplitude[:, None] * weights / weights.sum()
    return {
        "kind": "fourier",
        "duration_s": _number(duration_s),
        "fundamental_hz": _number(2.0 / duration_s),
        "ramp_s": _number(min(2.0, duration_s / 6.0)),
        "sine": [_numbers(row) for row in sizes * np.cos(phases)],
        "cosine": [_numbers(row) for row in sizes * np.sin(phases)],
    }


def _chirps(robot: Robot, pose: FloatArray, duration_s: float) -> list[dict[str, Any]]:
    """One joint after the other, as large as a share of its torque limit moves it."""
    inertia = np.diag(np.asarray(mass_matrix(robot, pose)))
    fastest = (2.0 * np.pi * _CHIRP_HZ[1]) ** 2
    each = duration_s / robot.dof
    segments = []
    for j, joint in enumerate(robot.joints):
        size = min(_CHIRP_EFFORT * joint.effort_limit / (inertia[j] * fastest), 0.02)
        amplitude = np.zeros(robot.dof)
        amplitude[j] = size
        segments.append(
            {
                "kind": "chirp",
                "duration_s": _number(each),
                "amplitude": _numbers(amplitude),
                "from_hz": _CHIRP_HZ[0],
                "to_hz": _CHIRP_HZ[1],
                "ramp_s": _number(each / 6.0),
            }
        )
    return segments
