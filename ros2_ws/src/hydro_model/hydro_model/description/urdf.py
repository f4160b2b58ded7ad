"""The serial chain of a URDF from its root to the tip link, what hangs on it lumped in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hydro_model.description.urdf_xml import parse_urdf
from hydro_model.errors import RobotError
from hydro_model.multibody.spatial import from_roll_pitch_yaw
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray, Joint

_MOVING = ("revolute", "continuous", "prismatic")
#: Links beside the way to the tip, one behind the other.
_MAX_BESIDE = 200


@dataclass(frozen=True, slots=True)
class SideBranch:
    """Links that hang on the chain by a movable joint, which counts as fixed at position 0.

    Attributes
    ----------
    joint : str
        The movable joint.
    carrier : str
        Moving link of the chain that they are lumped into.
    mass_kg : float
        Of all that is behind the joint.
    """

    joint: str
    carrier: str
    mass_kg: float


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
    branches : tuple of SideBranch
        Those with a mass.
    dry_friction : mapping of str to float
        `<dynamics friction>` by joint, where there is any: nothing uses it.
    """

    joints: tuple[Joint, ...]
    link_inertia: FloatArray
    tip_offset_m: FloatArray
    branches: tuple[SideBranch, ...] = ()
    dry_friction: Mapping[str, float] = field(default_factory=dict)


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
        The file is absent or malformed, the tip link unknown, a joint on the way mimics another,
        or a joint that matters is neither revolute, continuous, prismatic nor fixed.
    """
    model = parse_urdf(path)
    if tip_link not in model.link_map:
        known = ", ".join(model.link_map)
        raise RobotError(f"{path}: no link '{tip_link}' (links: {known})")
    way = _way_to(model, tip_link, path)
    joints: list[Joint] = []
    inertia: list[FloatArray] = []
    branches: list[SideBranch] = []
    rotation, translation = np.eye(3), np.zeros(3)
    for xml in way:
        _check_kind(xml, path)
        r, t = _origin(xml.origin)
        translation, rotation = translation + rotation @ t, rotation @ r
        if xml.type in _MOVING:
            joints.append(_joint(xml, rotation, translation, path))
            inertia.append(np.zeros(len(STANDARD_PARAMETERS)))
            rotation, translation = np.eye(3), np.zeros(3)
        if joints:
            inertia[-1] = inertia[-1] + _lumped(model, xml.child, rotation, translation, way)
            branches += _branches(model, xml.child, way, joints[-1].child_link, path)
    if not joints:
        raise RobotError(f"{path}: no moving joint between the root and '{tip_link}'")
    dry = {x.name: float(x.dynamics.friction) for x in way if x.dynamics and x.dynamics.friction}
    return Chain(tuple(joints), np.array(inertia), translation, tuple(branches), dry)


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


def _check_kind(xml: Any, path: Path) -> None:
    if xml.type not in (*_MOVING, "fixed"):
        raise RobotError(
            f"{path}: joint '{xml.name}' is {xml.type}, expected {', '.join(_MOVING)} or fixed"
        )


def _joint(xml: Any, rotation: FloatArray, translation: FloatArray, path: Path) -> Joint:
    axis = np.array([1.0, 0.0, 0.0] if xml.axis is None else xml.axis, dtype=float)
    norm = float(np.linalg.norm(axis))
    if not norm > 0.0:
        raise RobotError(f"{path}: joint '{xml.name}' has a zero axis")
    if xml.mimic is not None:
        raise RobotError(
            f"{path}: joint '{xml.name}' mimics '{xml.mimic.joint}', expected joints on the way to"
            " the tip that each move by themselves"
        )
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
    depth: int = 0,
) -> FloatArray:
    """Parameters of a link and of what hangs on it beside the chain, in the joint frame.

    Movable joints beside the chain stand at position 0.
    """
    if depth > _MAX_BESIDE:
        raise RobotError(
            f"link '{link}': expected at most {_MAX_BESIDE} joints in a row beside the chain"
        )
    total = _own(model.link_map[link], rotation, translation)
    for joint, child in _beside(model, link, way):
        r, t = _origin(joint.origin)
        total += _lumped(model, child, rotation @ r, translation + rotation @ t, way, depth + 1)
    return total


def _branches(
    model: Any, link: str, way: list[Any], carrier: str, path: Path
) -> Iterator[SideBranch]:
    """What hangs on a link by movable joints, directly or behind fixed ones, and has a mass."""
    for joint, child in _beside(model, link, way):
        _check_kind(joint, path)
        further = list(_branches(model, child, way, carrier, path))
        if joint.type == "fixed":
            yield from further
        elif mass_kg := float(_lumped(model, child, np.eye(3), np.zeros(3), way)[0]):
            yield SideBranch(joint.name, carrier, mass_kg)


def _beside(model: Any, link: str, way: list[Any]) -> Iterator[tuple[Any, str]]:
    """Joints that leave a link, and where they lead, without those on the way to the tip."""
    on_way = {joint.name for joint in way}
    for name, child in model.child_map.get(link, []):
        if name not in on_way:
            yield model.joint_map[name], child


def _own(link: Any, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    if link.inertial is None:
        return np.zeros(len(STANDARD_PARAMETERS))
    r, com = _origin(link.inertial.origin)
    tensor = np.array(link.inertial.inertia.to_matrix(), dtype=float)
    turned = rotation @ r
    return standard_parameters(
        float(link.inertial.mass), translation + rotation @ com, turned @ tensor @ turned.T
    )
