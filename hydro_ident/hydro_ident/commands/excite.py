"""`hydro_ident excite`: an experiment within the robot's limits, as files the controller plays."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report
from hydro_model.command_line.terminal import advance, progress_bar

if TYPE_CHECKING:
    from hydro_ident.design.experiment import Design
    from hydro_ident.design.information import Residual
    from hydro_model.robot import FloatArray, Robot

EXCITATION_FILE, VALIDATION_FILE = "excitation.yaml", "validation.yaml"
PREDICTION_FILE = "predicted.json"
_CAVITATES = (
    "a chamber is emptied faster than its valve edge fills it: its oil would cavitate in this run,"
    " which the predicted pressures, held at the tank's, do not show"
)


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="excite",
        description="Design an identification run and a validation run within the joint, stroke,"
        " speed, force and flow limits of a robot, as path files that the controller plays, and"
        " predict the standard error of every parameter.",
    )
    p.add_argument("--robot", required=True, help="robot file or the name of a shipped robot")
    p.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the files")
    p.add_argument(
        "--duration",
        type=float,
        default=64.0,
        metavar="S",
        help="of the run, 30 or more (default: %(default)g)",
    )
    p.add_argument("--seed", type=int, default=0, help="of the design's start (default: 0)")
    p.add_argument(
        "--force-residual",
        type=float,
        default=0.02,
        metavar="SHARE",
        help="expected residual of the force fit over the supply's force range (default: 0.02)",
    )
    p.add_argument(
        "--flow-residual",
        type=float,
        default=0.0075,
        metavar="SHARE",
        help="expected residual of the flow fit over an open edge's flow (default: 0.0075)",
    )
    p.add_argument(
        "--correlation",
        type=float,
        default=0.4,
        metavar="S",
        help="time constant of the residuals' correlation (default: 0.4)",
    )
    start = p.add_mutually_exclusive_group()
    start.add_argument(
        "--start-tip",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="tip position at start and end, m (default: the shipped path's first corner)",
    )
    start.add_argument(
        "--start-joints", nargs="+", type=float, metavar="Q", help="joint positions, rad or m"
    )
    add_json(p, f"{PREDICTION_FILE}'s content")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    import numpy as np

    from hydro_ident.design.experiment import (
        DESIGN_STAGES,
        design_excitation,
        design_validation,
        path_text,
        start_pose,
    )
    from hydro_ident.design.prediction import cavitating, predicted_json
    from hydro_ident.errors import IdentError
    from hydro_ident.identify.results import write_together
    from hydro_model.effects.catalogue import resolve
    from hydro_model.robot_files import load_robot

    robot = load_robot(options.robot)
    # What is wrong with a listed effect is said before the design, not after it.
    resolve(robot)
    if options.start_joints is not None:
        start = np.array(options.start_joints, dtype=float)
        if start.shape != (robot.dof,):
            raise IdentError(f"expected {robot.dof} joint positions, found {start.size}")
    else:
        start = start_pose(robot, None if options.start_tip is None else options.start_tip)
    residual = _residual(options)
    with tempfile.TemporaryDirectory() as name:
        folder, settings = Path(name), {"residual": residual, "seed": options.seed}
        with progress_bar():
            excitation = design_excitation(robot, start, options.duration, folder, **settings)
            advance("designing the validation run", 4, DESIGN_STAGES)
            validation = design_validation(
                robot, start, 0.5 * options.duration, folder, **settings
            )

    predicted = predicted_json(robot, excitation.prediction, residual, excitation.path.duration_s)

    def fill(fresh: Path) -> None:
        for file, design, text in (
            (EXCITATION_FILE, excitation, "to identify from"),
            (VALIDATION_FILE, validation, "another motion, to score predictions on"),
        ):
            comment = f"A run of robot {robot.name} {text}, by hydro_ident excite."
            (fresh / file).write_text(path_text(design.content, comment), encoding="utf-8")
        (fresh / PREDICTION_FILE).write_text(predicted, encoding="utf-8")

    write_together(options.out, fill, own=())
    lines = [
        _text(robot, excitation, options.out / EXCITATION_FILE),
        _text(robot, validation, options.out / VALIDATION_FILE),
        _table(excitation, options.out / PREDICTION_FILE),
    ]
    report(options.json, json.loads(predicted), "\n".join(lines))
    for what in excitation.left_out:
        print(f"excite: left out, since no size of it fits the limits: {what}", file=sys.stderr)
    for name in cavitating(robot, excitation.prediction):
        print(f"excite: {name}: {_CAVITATES}", file=sys.stderr)
    return 0


def _residual(options: argparse.Namespace) -> Residual:
    from hydro_ident.design.information import Residual
    from hydro_ident.errors import IdentError

    values = {
        "--force-residual": options.force_residual,
        "--flow-residual": options.flow_residual,
        "--correlation": options.correlation,
    }
    for name, value in values.items():
        if not 0.0 < value < float("inf"):
            raise IdentError(f"expected {name} above 0, found {value:g}")
    if options.seed < 0:
        raise IdentError(f"expected a seed of 0 or more, found {options.seed}")
    return Residual(options.force_residual, options.flow_residual, options.correlation)


def _table(design: Design, file: Path) -> str:
    """Expected standard errors, a line per parameter."""
    width = max(len(p.name) for p in design.prediction.parameters)
    lines = [f"{file}: expected standard errors of the excitation run"]
    for p in design.prediction.parameters:
        share = "" if p.relative is None else f"  {100.0 * p.relative:8.2f} %"
        value = "" if p.datasheet is None else f"{p.datasheet:.4g}"
        error = "undetermined" if p.std == float("inf") else f"+- {p.std:.3g} {p.unit}"
        lines.append(f"  {p.name:{width}}  {value:>10}  {error:28}{share}".rstrip())
    return "\n".join(lines)


def _text(robot: Robot, design: Design, file: Path) -> str:
    check = design.check
    lines = [
        f"{file}: {check.duration_s:.1f} s, condition number of the base regressor"
        f" {design.prediction.condition:.1f}"
        f" ({design.prediction.condition_scaled:.1f} with friction, unit columns)"
    ]
    for i, joint in enumerate(robot.joints):
        unit = "m" if joint.prismatic else "rad"
        lines.append(
            f"  {joint.name}: {check.lower[i]:.3f} to {check.upper[i]:.3f} {unit},"
            f" up to {check.peak_velocity[i]:.3f} {unit}/s"
        )
    for i, cylinder in enumerate(robot.cylinders):
        lines.append(f"  {cylinder.name}: {_cylinder_text(check.flow_share, design, i)}")
    lines.append(f"  {robot.tip_link}: up to {_fastest_tip(robot, design):.3f} m/s")
    return "\n".join(lines)


def _fastest_tip(robot: Robot, design: Design) -> float:
    from hydro_ident.design.limits import tip_speeds
    from hydro_model.motion.paths_check import CHECK_STEP_S, check_times
    from hydro_model.motion.paths_joints import joint_motion

    q, qd, _ = joint_motion(robot, design.path, check_times(design.path, CHECK_STEP_S))
    return float(tip_speeds(robot, q, qd).max())


def _cylinder_text(share: FloatArray, design: Design, i: int) -> str:
    check = design.check
    return (
        f"{check.stroke_lower_m[i]:.3f} to {check.stroke_upper_m[i]:.3f} m,"
        f" up to {check.peak_piston_velocity_m_s[i]:.3f} m/s,"
        f" {100.0 * share[i]:.0f} % of the valve's flow"
    )


def main() -> int:
    """Entry point."""
    return run_command("excite", run)


if __name__ == "__main__":
    sys.exit(main())
