"""What a datasheet would have and a robot file leaves to a default."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from hydro_model.description.fields import Fields
from hydro_model.robot import Robot
from hydro_model.robot_files import read_yaml


def missing_fields(robot: Robot) -> Iterator[tuple[str, str]]:
    """Places of the robot's file, and what is missing there.

    Parameters
    ----------
    robot : Robot
        Read from a file; nothing is said of another one.

    Yields
    ------
    about, text : str
    """
    if robot.source is None or not robot.cylinders:
        return
    top = read_yaml(robot.source)
    fluid, supply = top.fields("fluid", {}), top.fields("supply", {})
    cylinders = list(top.items("cylinders"))
    if "bulk_modulus_pa" not in fluid and any("bulk_modulus_pa" not in c for c in cylinders):
        yield "fluid", f"no bulk_modulus_pa: {robot.cylinders[0].bulk_modulus_pa:.3g} Pa is taken"
    if "tank_pressure_pa" not in supply:
        yield "supply", "no tank_pressure_pa: 0 is taken"
    yield from _folded(cylinders, _of_cylinder)
    yield from _folded(top.items("valves"), _of_valve)
    yield from _sensors(top.fields("sensors", {}), robot)


def _folded(
    items: Iterable[Fields], missing: Callable[[Fields], Iterable[str]]
) -> Iterator[tuple[str, str]]:
    """One line for all that lack the same: what is said of every cylinder is soon not read."""
    lacking: dict[str, list[str]] = {}
    for item in items:
        for text in missing(item):
            lacking.setdefault(text, []).append(item.text("name"))
    for text, names in lacking.items():
        yield ", ".join(names), text


def _of_cylinder(f: Fields) -> Iterator[str]:
    if "l1_m" not in f:
        return
    absent = [f"no {part}" for part in ("barrel", "rod") if f.optional_fields(part) is None]
    if absent:
        masses = "their masses count" if len(absent) > 1 else "its mass counts"
        yield f"{' and '.join(absent)}: {masses} as nothing"
    if "child_pin_angle_rad" not in f:
        yield "no child_pin_angle_rad: 0 is taken, which places barrel and rod"


def _of_valve(f: Fields) -> Iterator[str]:
    if "rated_voltage_v" not in f:
        yield "no rated_voltage_v: 10 V is taken"


def _sensors(f: Fields, robot: Robot) -> Iterator[tuple[str, str]]:
    given = robot.sensors
    encoder, pressure = f.fields("encoder", {}), f.fields("pressure", {})
    rows = (
        (f, "rate_hz", f"{given.rate_hz:g} Hz"),
        (encoder, "counts_per_rev", f"{given.encoder_counts_per_rev} counts"),
        (pressure, "range_pa", f"{given.pressure_range_pa:.3g} Pa"),
        (pressure, "resolution_pa", f"{given.pressure_resolution_pa:.3g} Pa"),
    )
    for where, key, taken in rows:
        if key not in where:
            yield "sensors", f"no {key}: {taken} is taken"
