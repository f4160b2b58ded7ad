"""Robots from files: URDF plus `*.hydraulics.yaml`, or an identified `model.yaml`.

Both YAML files have the same keys; `model.yaml` (schema `hydro_model/model/1`) adds what
identification found. Either names its URDF relative to itself, or by its whole path.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from hydro_model.description.fields import Fields
from hydro_model.description.robot_checks import (
    check_known,
    check_once,
    check_robot,
    within_strokes,
)
from hydro_model.description.safe_yaml import UnusableYamlError, parse
from hydro_model.description.shipped import shipped_robots as shipped_robots
from hydro_model.description.urdf import Chain, read_chain
from hydro_model.errors import RobotError
from hydro_model.robot import (
    PART_PARAMETERS,
    STANDARD_PARAMETERS,
    BaseParameter,
    Cylinder,
    CylinderPart,
    EffectSpec,
    FloatArray,
    Joint,
    Robot,
    Sensors,
    Valve,
)

MODEL_SCHEMA = "hydro_model/model/1"
MAX_FILE_BYTES = 4_000_000


def load_robot(
    robot: str | Path,
    *,
    check_strokes: bool = True,
    narrow: bool = False,
    bounded: bool = False,
) -> Robot:
    """Read a robot by file or by the name of a shipped robot.

    Parameters
    ----------
    robot : str or Path
        Path of a `*.hydraulics.yaml` or `model.yaml`, or a shipped name such as `xs031`.
    check_strokes : bool
        Refuse joint limits that move a piston out of its cylinder, and narrow those that do so
        by a little (`robot_checks.within_strokes`). Off only for whoever looks for that very
        mistake.
    narrow : bool
        Take joint limits that are wider than a cylinder's stroke, or not there, as ending where
        the piston does, with a warning: for recordings, in which limits bind nobody.
    bounded : bool
        Its URDF lies in or below its folder, by name and where links lead: for a file that was
        found by what a bag or a node says. One that its user names may name any.

    Returns
    -------
    Robot

    Raises
    ------
    RobotError
        The file is missing, malformed or contradicts its URDF; the message says what was
        expected, what was found and where.
    """
    shipped = shipped_robots()
    path = shipped.get(str(robot), Path(robot))
    if not is_file(path):
        names = ", ".join(shipped)
        raise RobotError(
            f"no robot file '{robot}': expected a *.hydraulics.yaml, a model.yaml"
            f" or a shipped robot ({names}){_instead(path)}"
        )
    if path.suffix.lower() == ".urdf":
        raise RobotError(f"{path}: expected a *.hydraulics.yaml, found a URDF{_instead(path)}")
    found = _robot_from(read_yaml(path), path, bounded=bounded, narrow=narrow)
    return within_strokes(found, path, narrow=narrow) if check_strokes else found


def _instead(path: Path) -> str:
    """What was probably meant, to go behind a message: a robot file in a folder, or beside."""
    whole = Path(f"{path}.hydraulics.yaml")
    if is_file(whole):
        return f"; did you mean '{whole}'?"
    try:
        folder = path.parent if path.suffix.lower() == ".urdf" else path
        files = sorted([*folder.glob("*.hydraulics.yaml"), *folder.glob("model.yaml")])
    except (OSError, ValueError):
        return ""
    if files:
        return f"; '{files[0]}' is one"
    return "; scripts/new_robot.sh makes one of it" if path.suffix.lower() == ".urdf" else ""


def is_file(path: Path) -> bool:
    """Whether there is a file; a name that no file can have is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_yaml(path: Path) -> Fields:
    """The mapping at the top of a YAML file, loaded safely; raises RobotError otherwise."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise RobotError(f"{path}: larger than {MAX_FILE_BYTES} bytes, no robot description")
        data = parse(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise RobotError(f"{path}: expected a text in UTF-8, found other bytes") from error
    except OSError as error:
        raise RobotError(f"{path}: cannot be read: {error}") from error
    except UnusableYamlError as error:
        raise RobotError(f"{path}: not valid YAML: {error}") from error
    if not isinstance(data, dict):
        found = {str: "a text", list: "a list", type(None): "nothing"}.get(type(data), "a value")
        raise RobotError(f"{path}: expected a mapping of keys, found {found}")
    return Fields(data, str(path))


def _robot_from(top: Fields, path: Path, *, bounded: bool, narrow: bool) -> Robot:
    schema = top.text("schema", MODEL_SCHEMA)
    if schema != MODEL_SCHEMA:
        raise RobotError(f"{path}: expected schema {MODEL_SCHEMA}, found '{schema}'")
    tip = top.text("tip_link")
    urdf = top.file_below("urdf", path) if bounded else top.file("urdf", path)
    chain = read_chain(urdf, tip)
    fluid, supply = top.fields("fluid", {}), top.fields("supply", {})
    bulk = fluid.positive("bulk_modulus_pa", 1.0e9)
    base = tuple(_base_parameter(f) for f in top.items("base_parameters"))
    names = [f"{j.child_link}.{p}" for j in chain.joints for p in STANDARD_PARAMETERS]
    robot = Robot(
        name=top.name("robot"),
        joints=_joints(top, chain, path),
        link_inertia=chain.link_inertia,
        tip_link=tip,
        tip_offset_m=chain.tip_offset_m,
        gravity_m_s2=top.vector("gravity_m_s2", 3, [0.0, 0.0, -9.81]),
        cylinders=tuple(_cylinder(f, bulk) for f in top.items("cylinders")),
        valves=tuple(_valve(f) for f in top.items("valves")),
        sensors=_sensors(top.fields("sensors", {})),
        atmospheric_pressure_pa=fluid.positive("atmospheric_pressure_pa", 101325.0),
        supply_pressure_pa=supply.number("pressure_pa", 0.0),
        tank_pressure_pa=supply.number("tank_pressure_pa", 0.0),
        command_delay_s=top.not_negative("command_delay_s", 0.0),
        effects=tuple(_effect(f) for f in top.items("effects")),
        base_parameters=base,
        base_covariance=_covariance(top, len(base)),
        standard_deviations=_deviations(top),
        standard_parameters=_standard_parameters(top, names, path),
        source=path,
        urdf=urdf,
    )
    for fields in (top, fluid, supply):
        fields.check_spelling()
    check_robot(robot, path, narrow=narrow)
    return _with_base(robot, path) if base else robot


def _joints(top: Fields, chain: Chain, path: Path) -> tuple[Joint, ...]:
    """The chain's joints, with what the file says of joints without cylinder."""
    friction = {f.text("name"): f.number("viscous_friction") for f in top.items("joints")}
    names = tuple(joint.name for joint in chain.joints)
    for name in friction:
        check_known("joints", "joint", name, names, path)
    return tuple(
        replace(j, viscous_friction=friction.get(j.name, j.viscous_friction)) for j in chain.joints
    )


def _deviations(top: Fields) -> dict[str, float]:
    if "standard_deviations" not in top:
        return {}
    return top.mapping_of_numbers("standard_deviations")


def _standard_parameters(top: Fields, names: list[str], path: Path) -> dict[str, float]:
    """Parameters of every link, and of other bodies where the file has them."""
    if "standard_parameters" not in top:
        return {}
    values = top.mapping_of_numbers("standard_parameters")
    absent = [name for name in names if name not in values]
    if absent:
        raise RobotError(f"{path}: standard_parameters lack '{absent[0]}', expected every link's")
    return values


def datasheet_inertia(robot: Robot) -> FloatArray:
    """Standard parameters (n, 10) of the links as the URDF has them.

    An identified robot's `link_inertia` carries its base parameters; this reads the URDF again.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    (n, 10) array
        Zeros for an identified robot without URDF.
    """
    if not robot.base_parameters:
        return robot.link_inertia
    if robot.urdf is None:
        return np.zeros_like(robot.link_inertia)
    return read_chain(robot.urdf, robot.tip_link).link_inertia


def _base_parameter(f: Fields) -> BaseParameter:
    combination = f.mapping_of_numbers("combination")
    return BaseParameter(f.text("name"), combination, f.number("value"))


def _covariance(top: Fields, size: int) -> FloatArray | None:
    if "base_covariance" not in top:
        return None
    return top.matrix("base_covariance", (size, size))


def _with_base(robot: Robot, path: Path) -> Robot:
    """The robot whose inertia is that of its base parameters."""
    from hydro_model.multibody.base_parameters import leading_value
    from hydro_model.multibody.closed_chain import with_parameters

    names = robot.parameter_names
    values = np.array(robot.parameter_vector, dtype=float)
    # What they hold of barrels and rods is in the base parameters.
    values[robot.link_inertia.size :] = 0.0
    given = dict(zip(names, values.tolist(), strict=True))
    check_once("base parameter", [parameter.name for parameter in robot.base_parameters], path)
    for parameter in robot.base_parameters:
        unknown = [n for n in (parameter.name, *parameter.combination) if n not in names]
        if unknown:
            raise RobotError(
                f"{path}: base parameter '{parameter.name}' names '{unknown[0]}', expected"
                f" <link>.<parameter> with a link of the chain and one of"
                f" {', '.join(STANDARD_PARAMETERS)}, or <cylinder>_<barrel or rod>.<parameter>"
                f" with one of {', '.join(PART_PARAMETERS)}"
            )
        # The rest, which no torque shows, is the URDF's.
        values[names.index(parameter.name)] = leading_value(
            parameter.name, parameter.value, parameter.combination, given
        )
    return with_parameters(robot, values)


def _part(f: Fields | None, pin: str) -> CylinderPart | None:
    if f is None:
        return None
    part = CylinderPart(
        mass_kg=f.not_negative("mass_kg"),
        com_from_pin_m=f.number(f"com_from_{pin}_pin_m"),
        inertia_com_kg_m2=f.not_negative("inertia_com_kg_m2"),
    )
    f.check_spelling()
    return part


def _cylinder(f: Fields, bulk_modulus_pa: float) -> Cylinder:
    direct = "l1_m" not in f
    cylinder = Cylinder(
        name=f.text("name"),
        joint=f.text("joint"),
        bore_m=f.positive("bore_m"),
        rod_m=f.number("rod_m"),
        stroke_m=f.positive("stroke_m"),
        l1_m=0.0 if direct else f.positive("l1_m"),
        l2_m=0.0 if direct else f.positive("l2_m"),
        q0_rad=0.0 if direct else f.number("q0_rad"),
        x0_m=f.number("x0_m", 0.0) if direct else f.number("x0_m"),
        child_pin_angle_rad=f.number("child_pin_angle_rad", 0.0),
        barrel=_part(f.optional_fields("barrel"), "parent"),
        rod=_part(f.optional_fields("rod"), "child"),
        bulk_modulus_pa=f.positive("bulk_modulus_pa", bulk_modulus_pa),
        viscous_friction=f.number("viscous_friction", 0.0),
        stroke_sensor=f.flag("stroke_sensor", False),
    )
    f.check_spelling()
    if not 0.0 <= cylinder.rod_m < cylinder.bore_m:
        raise RobotError(
            f"{f.where}: expected 0 <= rod_m < bore_m, found rod {cylinder.rod_m}"
            f" and bore {cylinder.bore_m}"
        )
    return cylinder


def _valve(f: Fields) -> Valve:
    edges = (f.positive(key) for key in ("c_pa", "c_at", "c_pb", "c_bt"))
    rated_v = f.positive("rated_voltage_v", 10.0)
    valve = Valve(f.text("name"), f.text("cylinder"), rated_v, *edges)
    f.check_spelling()
    return valve


def _sensors(f: Fields) -> Sensors:
    encoder, pressure = f.fields("encoder", {}), f.fields("pressure", {})
    counts = encoder.positive("counts_per_rev", 1 << 20)
    if counts < 1.0:
        raise RobotError(
            f"{encoder.where}: expected counts_per_rev of 1 or more, found {counts:g}"
        )
    sensors = Sensors(
        rate_hz=f.positive("rate_hz", 500.0),
        encoder_counts_per_rev=int(counts),
        pressure_range_pa=pressure.positive("range_pa", 25.0e6),
        pressure_resolution_pa=pressure.positive("resolution_pa", 1000.0),
    )
    for fields in (f, encoder, pressure):
        fields.check_known()
    return sensors


def _effect(f: Fields) -> EffectSpec:
    name, target = f.text("name"), f.text("target")
    if "parameters" not in f:
        from hydro_model.effects.catalogue import parameters_of  # it imports what a robot is

        raise RobotError(
            f"{f.where}: key 'parameters' is missing, expected a mapping of names to numbers;"
            f" '{name}' has {parameters_of(name, f.where)}"
        )
    return EffectSpec(name, target, f.mapping_of_numbers("parameters"))
