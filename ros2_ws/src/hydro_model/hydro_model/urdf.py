"""The serial chain of a URDF, from its root to the tip link, with fixed joints lumped in."""

from __future__ import annotations

import io
from collections import Counter
from contextlib import redirect_stderr
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from urdf_parser_py import urdf as urdf_xml

from hydro_model.errors import RobotError, in_short
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray, Joint
from hydro_model.spatial import from_roll_pitch_yaw

_MOVING = ("revolute", "continuous", "prismatic")
MAX_URDF_BYTES = 16_000_000
_MAX_DEPTH = 32
#: Links fixed to one another, one behind the other.
_MAX_FIXED = 200


@dataclass(frozen=True, slots=True)
class Chain:
    """What the URDF contributes to a `Robot`.

    Attributes
    ----------
    joints : tuple of Joint
    link_inertia : (n, 10) array
        Standard parameters in the joint frames.
    tip_offset_m : (3,) array
        Tip in the last joint frame.
    """

    joints: tuple[Joint, ...]
    link_inertia: FloatArray
    tip_offset_m: FloatArray


def standard_parameters(
    mass_kg: float, com_m: FloatArray, inertia_com_kg_m2: FloatArray
) -> FloatArray:
    """The ten standard parameters of a body in a frame (eq. 28).

    Parameters
    ----------
    mass_kg : float
    com_m : (3,) array
        Centre of mass in the frame.
    inertia_com_kg_m2 : (3, 3) array
        About the centre of mass, along the frame's axes.

    Returns
    -------
    (10,) array
        m, m c, and the inertia about the frame's origin (parallel axes).
    """
    first = mass_kg * com_m
    inertia = inertia_com_kg_m2 + mass_kg * (com_m @ com_m * np.eye(3) - np.outer(com_m, com_m))
    upper = inertia[np.triu_indices(3)]
    return np.concatenate(([mass_kg], first, upper))


def read_chain(path: Path, tip_link: str) -> Chain:
    """Read the chain from the root of a URDF to `tip_link`.

    Parameters
    ----------
    path : Path
    tip_link : str

    Returns
    -------
    Chain

    Raises
    ------
    RobotError
        The file is absent or malformed, the tip link unknown, or a joint on the way is neither
        revolute, continuous, prismatic nor fixed.
    """
    model = _parse(path)
    if tip_link not in model.link_map:
        known = ", ".join(model.link_map)
        raise RobotError(f"{path}: no link '{tip_link}' (links: {known})")
    way = _way_to(model, tip_link, path)
    joints: list[Joint] = []
    inertia: list[FloatArray] = []
    rotation, translation = np.eye(3), np.zeros(3)
    for xml in way:
        r, t = _origin(xml.origin)
        translation, rotation = translation + rotation @ t, rotation @ r
        if xml.type in _MOVING:
            joints.append(_joint(xml, rotation, translation, path))
            inertia.append(np.zeros(len(STANDARD_PARAMETERS)))
            rotation, translation = np.eye(3), np.zeros(3)
        elif xml.type != "fixed":
            raise RobotError(
                f"{path}: joint '{xml.name}' is {xml.type}, expected {', '.join(_MOVING)} or fixed"
            )
        if joints:
            inertia[-1] = inertia[-1] + _lumped(model, xml.child, rotation, translation, way)
    if not joints:
        raise RobotError(f"{path}: no moving joint between the root and '{tip_link}'")
    return Chain(tuple(joints), np.array(inertia), translation)


def _parse(path: Path) -> Any:
    if not path.is_file():
        raise RobotError(f"no URDF at {path}")
    if path.stat().st_size > MAX_URDF_BYTES:
        raise RobotError(f"{path}: larger than {MAX_URDF_BYTES} bytes, no URDF")
    _check_xml(path)
    # The parser prints what it does not know (materials, plugins) to stderr: not our user's news.
    with redirect_stderr(io.StringIO()):
        try:
            model = urdf_xml.URDF.from_xml_file(str(path))
            model.get_root()
        except Exception as error:  # the parser raises AssertionError, KeyError, ...
            raise RobotError(f"{path}: not a valid URDF: {in_short(error)}") from error
    _check_names(model, path)
    _check_numbers(model, path)
    return model


def _check_xml(path: Path) -> None:
    """Refuse what no URDF has and what could grow or nest without end, before it is parsed."""
    depth = 0

    def refuse(*_: object) -> None:
        raise RobotError(f"{path}: not a valid URDF: expected no document type or entities")

    def begin(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > _MAX_DEPTH:
            raise RobotError(f"{path}: not a valid URDF: elements nested deeper than {_MAX_DEPTH}")

    def end(_: object) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(path.read_bytes(), True)
    except (expat.ExpatError, ValueError, LookupError, OSError) as error:
        raise RobotError(f"{path}: not a valid URDF: {in_short(error)}") from error


def _check_names(model: Any, path: Path) -> None:
    """Refuse what the parser would resolve by taking the last one."""
    groups = {
        "link": [link.name for link in model.links],
        "joint": [joint.name for joint in model.joints],
        "child link": [joint.child for joint in model.joints],
    }
    for what, names in groups.items():
        twice = sorted(str(name) for name, count in Counter(names).items() if count > 1)
        if twice:
            raise RobotError(f"{path}: {what} '{twice[0]}' appears more than once")


def _check_numbers(model: Any, path: Path) -> None:
    for joint in model.joints:
        limit = joint.limit
        limits = [limit.lower, limit.upper, limit.velocity, limit.effort] if limit else []
        damping = [joint.dynamics.damping] if joint.dynamics else []
        numbers = [*_pose(joint.origin), joint.axis, limits, damping]
        _check_finite(f"joint '{joint.name}'", numbers, path)
    for link in model.links:
        if (body := link.inertial) is None:
            continue
        if body.inertia is None:
            raise RobotError(f"{path}: link '{link.name}' has a mass without <inertia>")
        numbers = [*_pose(body.origin), body.mass, body.inertia.to_matrix()]
        _check_finite(f"link '{link.name}'", numbers, path)
        if body.mass < 0.0:
            raise RobotError(
                f"{path}: link '{link.name}' has mass {body.mass}, expected 0 or more"
            )


def _pose(origin: Any) -> list[Any]:
    return [] if origin is None else [origin.xyz, origin.rpy]


def _check_finite(who: str, numbers: list[Any], path: Path) -> None:
    for value in numbers:
        if value is not None and not all(
            np.isfinite(v) for v in np.ravel(np.array(value, dtype=object)) if v is not None
        ):
            raise RobotError(f"{path}: {who} has {value}, expected finite numbers")


def _way_to(model: Any, tip_link: str, path: Path) -> list[Any]:
    way: list[Any] = []
    link = tip_link
    while link in model.parent_map:
        name, link = model.parent_map[link]
        way.append(model.joint_map[name])
        if len(way) > len(model.joint_map):
            raise RobotError(f"{path}: joints form a loop at link '{link}'")
    return way[::-1]


def _origin(origin: Any) -> tuple[FloatArray, FloatArray]:
    if origin is None:
        return np.eye(3), np.zeros(3)
    xyz = np.zeros(3) if origin.xyz is None else np.array(origin.xyz, dtype=float)
    rpy = [0.0, 0.0, 0.0] if origin.rpy is None else list(origin.rpy)
    return from_roll_pitch_yaw(*rpy), xyz


def _joint(xml: Any, rotation: FloatArray, translation: FloatArray, path: Path) -> Joint:
    axis = np.array([1.0, 0.0, 0.0] if xml.axis is None else xml.axis, dtype=float)
    norm = float(np.linalg.norm(axis))
    if not norm > 0.0:
        raise RobotError(f"{path}: joint '{xml.name}' has a zero axis")
    limit = xml.limit
    turning = xml.type == "continuous"
    if limit is None and not turning:
        raise RobotError(f"{path}: joint '{xml.name}' has no <limit>")
    lower, upper = (-np.inf, np.inf) if turning else (limit.lower or 0.0, limit.upper or 0.0)
    if not lower < upper:
        raise RobotError(
            f"{path}: joint '{xml.name}' has limits {lower} to {upper}, expected lower < upper"
        )
    return Joint(
        name=xml.name,
        parent_link=xml.parent,
        child_link=xml.child,
        prismatic=xml.type == "prismatic",
        translation_m=translation,
        rotation=rotation,
        axis=axis / norm,
        lower=float(lower),
        upper=float(upper),
        velocity_limit=float(limit.velocity or np.inf) if limit else np.inf,
        effort_limit=float(limit.effort or np.inf) if limit else np.inf,
        viscous_friction=float((xml.dynamics and xml.dynamics.damping) or 0.0),
    )


def _lumped(
    model: Any,
    link: str,
    rotation: FloatArray,
    translation: FloatArray,
    way: list[Any],
    fixed: int = 0,
) -> FloatArray:
    """Parameters of a link and of what is fixed to it beside the chain, in the joint frame."""
    if fixed > _MAX_FIXED:
        raise RobotError(f"link '{link}': expected at most {_MAX_FIXED} fixed joints in a row")
    total = _own(model.link_map[link], rotation, translation)
    on_way = {joint.name for joint in way}
    for name, child in model.child_map.get(link, []):
        joint = model.joint_map[name]
        if name in on_way or joint.type != "fixed":
            continue
        r, t = _origin(joint.origin)
        total += _lumped(model, child, rotation @ r, translation + rotation @ t, way, fixed + 1)
    return total


def _own(link: Any, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    if link.inertial is None:
        return np.zeros(len(STANDARD_PARAMETERS))
    r, com = _origin(link.inertial.origin)
    tensor = np.array(link.inertial.inertia.to_matrix(), dtype=float)
    turned = rotation @ r
    return standard_parameters(
        float(link.inertial.mass), translation + rotation @ com, turned @ tensor @ turned.T
    )
