"""A robot's URDF with other inertia in its moving links."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from hydro_ident.errors import IdentError
from hydro_ident.identify.consistent_robot import central
from hydro_model.robot import STANDARD_PARAMETERS, Robot

_NOTE = " Inertia of the moving links by hydro_ident, what hangs on them lumped in. "


def urdf_with_inertia(robot: Robot) -> str:
    """The robot's URDF with its standard parameters, everything else as it was.

    Parameters
    ----------
    robot : Robot
        With `standard_parameters` of every link and a URDF.

    Returns
    -------
    str
        A moving link carries all that hangs on it beside the chain; those links lose their own
        inertia.

    Raises
    ------
    IdentError
        There is no URDF, it cannot be read, or the robot has no standard parameters.
    """
    if robot.urdf is None or not robot.standard_parameters:
        raise IdentError(f"robot {robot.name}: expected a URDF and standard parameters")
    root = _read(robot.urdf)
    links = {link.get("name", ""): link for link in root.iter("link")}
    for lumped in _lumped(root, set(robot.link_names)):
        for old in links[lumped].findall("inertial"):
            links[lumped].remove(old)
    for name in robot.link_names:
        link = links[name]
        for old in link.findall("inertial"):
            link.remove(old)
        own = {p: robot.standard_parameters[f"{name}.{p}"] for p in STANDARD_PARAMETERS}
        link.insert(0, _inertial(own))
    root.insert(0, ElementTree.Comment(_NOTE))
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0"?>\n{body}\n'


def write_urdf(robot: Robot, file: Path) -> bool:
    """Write the robot's URDF with its standard parameters.

    Parameters
    ----------
    robot : Robot
    file : Path
        Never the robot's own URDF's name: a model file beside it refers to that.

    Returns
    -------
    bool
        Whether it was written: not without standard parameters, not over the robot's own name.
    """
    if robot.urdf is None or not robot.standard_parameters or robot.urdf.name == file.name:
        return False
    file.write_text(urdf_with_inertia(robot), encoding="utf-8")
    return True


def _read(path: Path) -> ElementTree.Element:
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    try:
        return ElementTree.parse(path, parser).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise IdentError(f"{path}: cannot be read as XML: {error}") from error


def _lumped(root: ElementTree.Element, moving: set[str]) -> set[str]:
    """Links that hang on a moving link of the chain, directly or through others."""
    pairs = []
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            pairs.append((parent.get("link", ""), child.get("link", "")))
    found: set[str] = set()
    while new := {c for p, c in pairs if p in moving | found} - found - moving:
        found |= new
    return found


def _inertial(parameters: dict[str, float]) -> ElementTree.Element:
    com, inertia = central(parameters)
    element = ElementTree.Element("inertial")
    xyz = " ".join(repr(float(v)) for v in com)
    ElementTree.SubElement(element, "origin", xyz=xyz, rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=repr(parameters["mass"]))
    axes = "xyz"
    numbers = {
        f"i{axes[i]}{axes[k]}": repr(float(inertia[i, k])) for i in range(3) for k in range(i, 3)
    }
    ElementTree.SubElement(element, "inertia", numbers)
    return element
