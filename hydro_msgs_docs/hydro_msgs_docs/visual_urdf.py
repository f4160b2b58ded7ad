"""A URDF to look at: the robot's own, with plain bodies for links, barrels and rods that move.

The bodies are boxes and cylinders along the lines that the robot description has: from joint to
joint, from joint axis to pin, from pin to pin. They show the geometry that everything computes
with, not the machine's shape. Links that have a `<visual>` keep it.
"""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from hydro_model.description.visual_joints import barrel_angle, barrel_joint, rod_joint
from hydro_model.errors import RobotError
from hydro_model.multibody.closed_chain import PartPlace, part_places
from hydro_model.robot import Cylinder, FloatArray, Joint, Robot

#: Colours: links, arms to the pins, barrels, rods (Okabe and Ito's palette, and steel).
_COLOURS = {
    "link": "0.902 0.624 0.000 1",
    "arm": "0.337 0.706 0.914 1",
    "barrel": "0.000 0.447 0.698 1",
    "rod": "0.750 0.750 0.780 1",
}
#: Thickness of a link over the longest link, and of an arm over a link's.
_THICK, _ARM = 0.06, 0.5
#: Outer over inner diameter of a barrel; share of the closed length that is barrel.
_WALL, _BARREL = 1.25, 0.93
#: What a barrel covers of its rod at full stroke at least, as a share of the stroke: where a joint
#: that slides counts from the closed cylinder, no length of that is known.
_COVER = 0.02
_LEAST_M = 1e-3


def visual_urdf(robot: Robot) -> str:
    """The URDF with bodies to look at.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    str
        Its moving joints are those of `hydro_model.description.visual_joints.visual_joint_names`.
        Barrels and rods have no inertia: it is made to be drawn, not to be simulated.

    Raises
    ------
    RobotError
        The robot has no readable URDF, or one of its names is taken by a cylinder's part.
    """
    root = _root(robot)
    bare = {str(e.get("name")): e for e in root.iter("link") if e.find("visual") is None}
    base = base_link(robot, root)
    for colour, rgba in _COLOURS.items():
        material = Element("material", name=f"visual_{colour}")
        SubElement(material, "color", rgba=rgba)
        root.insert(0, material)
    ends = [*(j.translation_m for j in robot.joints[1:]), robot.tip_offset_m]
    thick = _THICK * max([float(np.linalg.norm(end)) for end in ends] + [0.1])
    for joint, end in zip(robot.joints, ends, strict=True):
        if joint.child_link in bare:
            _bar(bare[joint.child_link], np.zeros(3), end, thick, "link")
    if base in bare:
        _bar(bare[base], np.zeros(3), robot.joints[0].translation_m, thick, "link")
    places = iter(part_places(robot))
    for cylinder in robot.cylinders:
        i = robot.joint_index(cylinder.joint)
        at, host = robot.joints[i], base if i == 0 else robot.joints[i - 1].child_link
        if cylinder.l1_m == 0.0:
            _add_along(root, cylinder, at, host)
            continue
        parent, child = next(places), next(places)
        if host in bare:
            _bar(bare[host], at.translation_m, parent.pin_m, _ARM * thick, "arm")
        if at.child_link in bare:
            _bar(bare[at.child_link], np.zeros(3), child.pin_m, _ARM * thick, "arm")
        _add_between_pins(root, cylinder, parent, host, (at.lower, at.upper))
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


def base_link(robot: Robot, root: Element | None = None) -> str:
    """The link that a robot stands on: the root of its URDF.

    Parameters
    ----------
    robot : Robot
    root : Element, optional
        Its URDF, where it has been read.

    Returns
    -------
    str
    """
    root = _root(robot) if root is None else root
    children = {str(child.get("link")) for child in root.iter("child")}
    return next(n for e in root.iter("link") if (n := str(e.get("name"))) not in children)


def _root(robot: Robot) -> Element:
    if robot.urdf is None:
        raise RobotError(f"robot {robot.name}: no URDF beside {robot.source}")
    try:
        return ElementTree.parse(robot.urdf).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise RobotError(f"{robot.urdf}: cannot be read as XML: {error}") from error


def _add_between_pins(
    root: Element, c: Cylinder, place: PartPlace, host: str, limits: tuple[float, float]
) -> None:
    """A barrel that turns about its pin, towards the other one."""
    # x from the pin towards the joint axis, turning about z.
    across = np.cross(place.axis, -place.towards)
    frame = np.stack([-place.towards, across, place.axis], axis=1)
    lower, upper = limits if np.isfinite(limits).all() else (-np.pi, np.pi)
    angles = np.unwrap(barrel_angle(c, np.linspace(lower, upper, 101)))
    turn = _add_barrel(root, c, "revolute", host)
    _origin(turn, place.pin_m, frame)
    SubElement(turn, "axis", xyz="0 0 1")
    _limit(turn, float(angles.min()) - 0.1, float(angles.max()) + 0.1)
    _add_rod(root, c)


def _add_along(root: Element, c: Cylinder, joint: Joint, host: str) -> None:
    """A barrel that stands along the axis of a joint that slides; its rod ends at the link."""
    stands = _add_barrel(root, c, "fixed", host)
    _origin(stands, joint.translation_m, joint.rotation @ _frame_along(joint.axis))
    _add_rod(root, c)


def _add_barrel(root: Element, c: Cylinder, kind: str, host: str) -> Element:
    """The joint of a barrel, and of the link behind it."""
    barrel, rod = barrel_joint(c.name), rod_joint(c.name)
    taken = {str(e.get("name")) for e in root if e.tag in ("link", "joint")}
    for name in (barrel, rod, f"{barrel}_link", f"{rod}_link"):
        if name in taken:
            raise RobotError(f"the URDF has a '{name}' already, which would be of {c.name}")
    return _joint(root, barrel, kind, host, f"{barrel}_link")


def _add_rod(root: Element, c: Cylinder) -> None:
    """A rod that slides out of its barrel along x, and the bodies of both."""
    barrel, rod = f"{barrel_joint(c.name)}_link", f"{rod_joint(c.name)}_link"
    slide = _joint(root, rod_joint(c.name), "prismatic", barrel, rod)
    _origin(slide, np.array([c.x0_m, 0.0, 0.0]), np.eye(3))
    SubElement(slide, "axis", xyz="1 0 0")
    _limit(slide, -0.1 * c.stroke_m, 1.1 * c.stroke_m)
    cover = max((1.0 - _BARREL) * abs(c.x0_m), _COVER * c.stroke_m)
    mouth, reach = c.x0_m - cover, c.stroke_m + 2.0 * cover
    # A barrel hung in its middle, or a dead length shorter than the stroke, reaches past its pin.
    bottom = min(0.0, c.x0_m - reach)
    links = {str(e.get("name")): e for e in root.iter("link")}
    _round(links[barrel], bottom, mouth, 0.5 * _WALL * c.bore_m, "barrel")
    _round(links[rod], -reach, 0.0, 0.5 * c.rod_m, "rod")


def _joint(root: Element, name: str, kind: str, parent: str, child: str) -> Element:
    SubElement(root, "link", name=child)
    joint = SubElement(root, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    return joint


def _limit(joint: Element, lower: float, upper: float) -> None:
    SubElement(
        joint, "limit", lower=f"{lower:.6g}", upper=f"{upper:.6g}", effort="0", velocity="0"
    )


def _origin(parent: Element, at: FloatArray, turn: FloatArray) -> None:
    SubElement(parent, "origin", xyz=_numbers(at), rpy=_numbers(rpy_of(turn)))


def rpy_of(turn: FloatArray) -> FloatArray:
    """Roll, pitch and yaw of a URDF: turns about the fixed x, y and z.

    Parameters
    ----------
    turn : (3, 3) array
        Rotation.

    Returns
    -------
    (3,) array
        rad; yaw 0 where x stands upright and only its sum with roll is told.
    """
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], level)
    if level < 1e-9:
        return np.array([np.arctan2(np.sign(pitch) * turn[0, 1], turn[1, 1]), pitch, 0.0])
    roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    return np.array([roll, pitch, yaw])


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{v:.12g}" for v in np.where(np.abs(values) < 1e-15, 0.0, values))


def _frame_along(direction: FloatArray) -> FloatArray:
    """A rotation (3, 3) whose x axis is a direction."""
    x = np.asarray(direction) / np.linalg.norm(direction)
    # Any direction that is not along it.
    y = np.cross(np.eye(3)[int(np.argmin(np.abs(x)))], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _bar(link: Element, begin: FloatArray, end: FloatArray, thick: float, colour: str) -> None:
    """A box from point to point."""
    along = np.asarray(end) - begin
    length = float(np.linalg.norm(along))
    if length < _LEAST_M:
        return
    visual = SubElement(link, "visual")
    _origin(visual, begin + 0.5 * along, _frame_along(along))
    box = SubElement(SubElement(visual, "geometry"), "box")
    box.set("size", _numbers(np.array([length, thick, thick])))
    SubElement(visual, "material", name=f"visual_{colour}")


def _round(link: Element, begin: float, end: float, radius: float, colour: str) -> None:
    """A cylinder along the link's x axis."""
    visual = SubElement(link, "visual")
    upright = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    _origin(visual, np.array([0.5 * (begin + end), 0.0, 0.0]), upright)
    shape = SubElement(SubElement(visual, "geometry"), "cylinder")
    shape.set("radius", f"{radius:.6g}")
    shape.set("length", f"{end - begin:.6g}")
    SubElement(visual, "material", name=f"visual_{colour}")
