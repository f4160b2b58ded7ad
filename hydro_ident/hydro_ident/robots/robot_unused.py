"""What a robot's files say and nothing computes with, or not as they say it."""

from __future__ import annotations

from collections.abc import Iterator

from hydro_model.description.urdf import Chain, read_chain
from hydro_model.robot import Robot


def unused_fields(robot: Robot) -> Iterator[tuple[str, str]]:
    """Joints of the robot's files, and what of them counts otherwise than it stands there.

    Parameters
    ----------
    robot : Robot
        Nothing is said of its URDF where it has none.

    Yields
    ------
    about, text : str
    """
    if robot.urdf is not None:
        yield from _of_urdf(read_chain(robot.urdf, robot.tip_link), robot.tip_link)
    driven = {cylinder.joint: cylinder.name for cylinder in robot.cylinders}
    for joint in robot.joints:
        if joint.viscous_friction != 0.0 and joint.name in driven:
            unit = "N s/m" if joint.prismatic else "N m s/rad"
            yield (
                joint.name,
                f"its viscous friction of {joint.viscous_friction:g} {unit} (the URDF's damping,"
                " or `joints`) is not used: where there is a cylinder, the friction is the"
                f" piston's, viscous_friction of '{driven[joint.name]}' in N s/m",
            )


def _of_urdf(chain: Chain, tip_link: str) -> Iterator[tuple[str, str]]:
    for branch in chain.branches:
        yield (
            branch.joint,
            f"moves beside the way to '{tip_link}': the {branch.mass_kg:.4g} kg behind it count"
            f" as fixed to '{branch.carrier}' at position 0; a barrel or rod among them that the"
            " robot file has too counts twice",
        )
    for name, friction in chain.dry_friction.items():
        yield (
            name,
            f"the URDF's friction of {friction:g} is not used: coulomb_friction among the robot"
            " file's effects is",
        )
