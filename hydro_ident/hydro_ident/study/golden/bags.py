"""The golden bags, made on the rig's truth plant from a seed."""

from __future__ import annotations

import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_ident.study.closed_loop import Run, run_closed_loop
from hydro_ident.study.machine_bags import write_bag
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.robot_files import load_robot

ROBOT, TRUTH, SEED = "xs031", "realistic", 6
CONTROL_BAG, DIAGNOSIS_BAG = "control_bag", "diagnosis_bag"
#: What the controller is replayed along, its first hold, and how long it was recorded.
START_TIP_M = [2.0, 0.0, -1.2]
PATH = TipPath.through([START_TIP_M, [2.3, 0.0, -1.1]], [1.0])
DELAY_S, CONTROL_S = 0.2, 1.5
#: The diagnosis' bag: so long, every so many cycles, from pose to pose in so long.
DIAGNOSIS_S, EVERY, LEG_S = 14.0, 5, 1.2
#: What of a cylinder's truth is its friction.
_FRICTION = (
    *("viscous_friction", "coulomb_friction_n", "static_friction_n", "stribeck_velocity_m_s"),
    *("bristle_deflection_m", "bristle_damping"),
)
#: Share of the joints' ranges that is driven.
_USED = 0.5
_PEAK, _FASTEST_RAD_S = 1.875, 0.5


def make_bags(folder: Path) -> None:
    """Make both bags anew.

    Parameters
    ----------
    folder : Path
        Of the golden files.
    """
    make_control_bag(folder / CONTROL_BAG)
    path = wandering(np.random.default_rng(SEED))
    run = _driven(path, 0.0, DIAGNOSIS_S, with_two_effects(load_truth(TRUTH, load_robot(ROBOT))))
    seldom = {field.name: getattr(run, field.name)[::EVERY] for field in fields(run)}
    _write(folder / DIAGNOSIS_BAG, replace(run, **seldom))


def make_control_bag(bag: Path) -> None:
    """Make the controller's bag anew.

    Parameters
    ----------
    bag : Path
    """
    _write(bag, _driven(PATH, DELAY_S, CONTROL_S, load_truth(TRUTH, load_robot(ROBOT))))


def with_two_effects(truth: Truth) -> Truth:
    """A machine whose last cylinder rubs and whose first valve overlaps, and nothing else.

    Its links, delay and sensors are another's. All that a machine may have takes minutes.

    Parameters
    ----------
    truth : Truth
        The other, with dry friction and overlap.
    """
    plain = load_truth("ideal", load_robot(ROBOT))
    rubbing = {name: getattr(truth.cylinders[-1], name) for name in _FRICTION}
    overlap, rounding = truth.valves[0].deadband, truth.valves[0].deadband_rounding
    return replace(
        plain,
        links=truth.links,
        sensors=truth.sensors,
        command_delay_cycles=truth.command_delay_cycles,
        cylinders=(*plain.cylinders[:-1], replace(plain.cylinders[-1], **rubbing)),
        valves=(
            replace(plain.valves[0], deadband=overlap, deadband_rounding=rounding),
            *plain.valves[1:],
        ),
    )


def _driven(path: TipPath | JointPath, delay_s: float, duration_s: float, truth: Truth) -> Run:
    robot = load_robot(ROBOT)
    rig = RigCore(robot, truth, seed=SEED, tip_m=START_TIP_M)
    core = ControllerCore(robot, Gains(), path, start_delay_s=delay_s)
    return run_closed_loop(rig, core, duration_s)


def wandering(random: np.random.Generator) -> JointPath:
    """From pose to pose, drawn from the middle of the joints' ranges.

    Parameters
    ----------
    random : Generator
    """
    robot = load_robot(ROBOT)
    rig = RigCore(robot, load_truth("ideal", robot), seed=0, tip_m=START_TIP_M)
    low = np.array([joint.lower for joint in robot.joints])
    high = np.array([joint.upper for joint in robot.joints])
    legs = round(DIAGNOSIS_S / LEG_S)
    share = 0.5 + _USED * (random.random((legs, len(low))) - 0.5)
    poses = np.vstack([rig.plant.q, low + share * (high - low)])
    largest = np.abs(np.diff(poses, axis=0)).max(axis=1)
    # A quintic's peak speed is 1.875 times its mean.
    durations = np.maximum(LEG_S, _PEAK * largest / _FASTEST_RAD_S)
    legs_of = zip(poses[:-1].tolist(), poses[1:].tolist(), durations.tolist(), strict=True)
    segments = tuple(Quintic.at_rest(a, b, t) for a, b, t in legs_of)
    return JointPath(segments, joints=robot.joint_names)


def _write(bag: Path, run: Run) -> None:
    shutil.rmtree(bag, ignore_errors=True)
    write_bag(bag, load_robot(ROBOT), run)
