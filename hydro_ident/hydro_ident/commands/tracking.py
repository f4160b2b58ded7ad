"""`tracking`: how well the tip followed its reference."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydro_model.command_line.command import Parser, run_command, warn
from hydro_model.command_line.output import add_json, report
from hydro_model.command_line.terminal import advance, progress_bar

if TYPE_CHECKING:
    from hydro_ident.bag.reader import Bag
    from hydro_ident.bag.recording import Recording
    from hydro_ident.recordings.metrics import Tracking
    from hydro_model.arrays import FloatArray
    from hydro_model.robot import Robot


def main(arguments: Sequence[str] | None = None) -> int:
    """The `tracking` executable."""
    return run_command("tracking", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="tracking",
        description="Tip RMSE, largest error, largest speed and rho = largest error / largest"
        " speed over the span in which the tip reference moves.",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 directory or .mcap file")
    parser.add_argument(
        "--robot",
        help="robot file or shipped robot (default: the bag's own, or of a bag that"
        " names none the shipped one with its joints)",
    )
    parser.add_argument("--truth", type=Path, help="side file of the simulated rig (.npz)")
    add_json(parser)
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    from hydro_ident.bag.reader import read_bag
    from hydro_ident.bag.recording import RECORDING_TOPICS
    from hydro_model.robot_files import load_robot

    with progress_bar():
        bag = read_bag(options.bag, RECORDING_TOPICS)
        robot = _robot_of(bag) if options.robot is None else load_robot(options.robot, narrow=True)
        advance("following the tip", 1, 1)
        rows = tracking_of(bag, robot, options.truth)
    report(options.json, _as_dict(bag, rows), _text(rows))
    guessed = options.robot is None and not bag.metadata.get("robot")
    by_joints = [f"the bag names no robot: read as {robot.name}, whose joints it has"] * guessed
    warn("tracking", (*by_joints, *warnings_of(bag, robot, rows)))
    return 0


def _robot_of(bag: Bag) -> Robot:
    """The shipped robot that a bag names, or whose joints it has."""
    from hydro_ident.errors import BagError
    from hydro_ident.inspecting.named_robot import named_robot, robot_of_joints
    from hydro_msgs_docs.topics import JOINT_STATES

    named, joints = bag.metadata.get("robot", ""), bag.series.get(JOINT_STATES)
    if named:
        robot = named_robot(bag.metadata)
    else:
        robot = None if joints is None else robot_of_joints(joints.names)
    if robot is None:
        raise BagError(
            f"{bag.path}: expected the name of a shipped robot in the bag, or its joints, found"
            f" '{named}': give the --robot that the tip is of"
        )
    return robot


def warnings_of(bag: Bag, robot: Robot, rows: Mapping[str, Tracking]) -> list[str]:
    """What is to be said beside the figures of a bag.

    Parameters
    ----------
    bag : Bag
    robot : Robot
    rows : mapping of str to Tracking
        Of `tracking_of`.

    Returns
    -------
    list of str
    """
    # Gaps are the same in all rows, what is not compared may be more of the truth.
    holes = dict.fromkeys(text for row in rows.values() for text in row.holes)
    return [*bag.losses, *bag.unchecked, *other_machine(bag, robot), *holes]


def other_machine(bag: Bag, robot: Robot) -> list[str]:
    """A sentence where the tip is computed by another robot than the bag names.

    Parameters
    ----------
    bag : Bag
    robot : Robot
    """
    from hydro_ident.bag.recorded_run import other_robot

    name = other_robot(bag.metadata, robot)
    if not name:
        return []
    return [f"recorded as '{name}', not {robot.name}: the tip is that of another machine's links"]


def tracking_of(bag: Bag, robot: Robot, truth: Path | None = None) -> dict[str, Tracking]:
    """Tracking figures of a bag, of every cycle of the joints: no pressure has a part in them.

    Parameters
    ----------
    bag : Bag
    robot : Robot
    truth : Path, optional
        Side file of the simulated rig.

    Returns
    -------
    dict of str to Tracking
        `encoders`, and `truth` where a side file is given.

    Raises
    ------
    BagError
        As `recording_of` and `true_tip_m`.
    NotEnoughDataError
        No tip reference, or a joint without a position; the reference or the tip never moves.
    """
    import numpy as np

    from hydro_ident.bag.recording import recording_of
    from hydro_ident.errors import NotEnoughDataError
    from hydro_ident.recordings.metrics import ENCODER_HALF_WIDTH, TRUTH_HALF_WIDTH, tracking
    from hydro_ident.recordings.truth_file import true_tip_m
    from hydro_model.multibody.kinematics import tip_position

    recording = recording_of(_without_pressures(bag), robot)
    reference = _reference(recording)
    absent = [j for i, j in enumerate(robot.joint_names) if np.isnan(recording.q[:, i]).all()]
    if absent:
        told = ", ".join(absent)
        raise NotEnoughDataError(f"{bag.path}: expected positions of {told}, found none")
    stamps = recording.stamp_ns
    tip_m = np.asarray(tip_position(robot, recording.q))
    rows = {"encoders": tracking(stamps, tip_m, reference, half_width=ENCODER_HALF_WIDTH)}
    if truth is not None:
        tip_m = true_tip_m(truth, bag, recording, tip_m)
        rows["truth"] = tracking(stamps, tip_m, reference, half_width=TRUTH_HALF_WIDTH)
    return rows


def _without_pressures(bag: Bag) -> Bag:
    """A bag as if nobody had recorded pressures: cycles then are those of the joints alone."""
    from hydro_msgs_docs.topics import CHAMBER_PRESSURES

    topics = {name: info for name, info in bag.topics.items() if name != CHAMBER_PRESSURES}
    series = {name: one for name, one in bag.series.items() if name != CHAMBER_PRESSURES}
    return replace(bag, topics=topics, series=series)


def _reference(recording: Recording) -> FloatArray:
    from hydro_ident.errors import NotEnoughDataError
    from hydro_msgs_docs.topics import TIP_REFERENCE

    if recording.tip_ref is None:
        raise NotEnoughDataError(
            f"{recording.path}: expected {TIP_REFERENCE} on the cycles' stamps, found none: record"
            " a run in which the controller moves the tip, with all its topics"
        )
    return recording.tip_ref


def _as_dict(bag: Bag, rows: dict[str, Tracking]) -> dict[str, Any]:
    """The best known tip at the top level, the encoders' beside it."""
    best = rows.get("truth", rows["encoders"])
    return {
        "schema": "hydro_ident/tracking/1",
        "bag": str(bag.path),
        "damage": list(bag.losses),
        "checksummed": bag.checksummed,
        "source": "truth" if "truth" in rows else "encoders",
        **asdict(best),
        **{name: asdict(row) for name, row in rows.items()},
    }


def _text(rows: dict[str, Tracking]) -> str:
    heads = ("RMSE mm", "max error mm", "max speed m/s", "rho s", "reference m/s")
    lines = [f"{'tip from':10s}" + "".join(f"{head:>15s}" for head in heads)]
    for name, row in rows.items():
        values = (
            row.rmse_mm,
            row.max_error_mm,
            row.max_speed_m_s,
            row.rho_s,
            row.reference_speed_m_s,
        )
        lines.append(f"{name:10s}" + "".join(f"{value:15.4f}" for value in values))
    return "\n".join(lines)
