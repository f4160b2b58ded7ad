"""A URDF as its parser has it, with what the parser leaves unchecked."""

from __future__ import annotations

import io
from collections import Counter
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from urdf_parser_py import urdf as urdf_xml

from hydro_model.errors import RobotError, in_short

MAX_URDF_BYTES = 16_000_000
_MAX_DEPTH = 32


def parse_urdf(path: Path) -> Any:
    """Read a URDF and check what its parser does not.

    Parameters
    ----------
    path : Path

    Returns
    -------
    urdf_parser_py.urdf.URDF

    Raises
    ------
    RobotError
        The file is absent or no URDF, a name is given twice, or a number is not finite.
    """
    try:
        found, size = path.is_file(), path.stat().st_size
    except FileNotFoundError:
        found, size = False, 0
    except (OSError, ValueError) as error:  # links in a circle, a folder that is closed to us
        raise RobotError(f"{path}: cannot be read: {error}") from error
    if not found:
        raise RobotError(f"no URDF at {path}")
    if size > MAX_URDF_BYTES:
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
        losses = [joint.dynamics.damping, joint.dynamics.friction] if joint.dynamics else []
        numbers = [*_pose(joint.origin), joint.axis, limits, losses]
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
