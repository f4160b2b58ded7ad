"""A hydraulics file to start from: a URDF, pins by the tape measure, numbers from datasheets.

Geometry is asked for as it is measured, two pins as (x, y) from the joint's axis, and written as
the robot file wants it (eq. 16). What a datasheet seldom says, and what was not given, is left to
the file's defaults, which `check_robot` lists.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import write_text
from hydro_model.errors import RobotError
from hydro_model.robot import Sensors

_OPTIONS = {
    "--rated-voltage": ("V", "of the valves at full signal (not stated without: 10 is taken)"),
    "--rate": ("HZ", "samples of the machine per second (not stated without: 500 is taken)"),
    "--pressure-range": (
        "BAR",
        "end of the pressure sensors' range, gauge (not stated without: 250 is taken)",
    ),
}
#: How far the pins of a cylinder along a joint may be beside one another, over its closed length:
#: its length is then that along the joint to a five-thousandth.
ASKEW = 0.02
_NUMBERS = ("PX", "PY", "CX", "CY", "BORE", "ROD", "STROKE", "CLOSED")


@dataclass(frozen=True, slots=True)
class MeasuredCylinder:
    """A cylinder as one measures it; metres.

    Attributes
    ----------
    joint : str
    parent_pin_m, child_pin_m : (float, float)
        Pins from the joint's axis at q = 0, in the plane in which positive turns
        counter-clockwise, x along the child link's x axis. Of a joint that slides x is along its
        axis.
    bore_m, rod_m, stroke_m : float
    closed_m : float
        From pin to pin with the rod fully in.
    slides : bool
        The joint is prismatic, and the cylinder lies along it.
    """

    joint: str
    parent_pin_m: tuple[float, float]
    child_pin_m: tuple[float, float]
    bore_m: float
    rod_m: float
    stroke_m: float
    closed_m: float
    slides: bool = False

    def lines(self) -> list[str]:
        """The cylinder's entry in the file."""
        return [
            f"  - name: {self.joint}_cylinder",
            f"    joint: {self.joint}",
            f"    bore_m: {self.bore_m:g}",
            f"    rod_m: {self.rod_m:g}",
            f"    stroke_m: {self.stroke_m:g}",
            *(self._along() if self.slides else self._triangle()),
        ]

    def _along(self) -> list[str]:
        """Where a joint that slides is with the rod fully in."""
        (px, py), (cx, cy) = self.parent_pin_m, self.child_pin_m
        if cx <= px or abs(cy - py) > ASKEW * self.closed_m:
            raise RobotError(
                f"--cylinder {self.joint}: on a joint that slides, x being along its axis,"
                f" expected the cylinder along it, CX above PX and CY as PY, found {px:g} {py:g}"
                f" and {cx:g} {cy:g}"
            )
        return [f"    x0_m: {self.closed_m - (cx - px):.5f}"]

    def _triangle(self) -> list[str]:
        parent, child = (math.atan2(y, x) for x, y in (self.parent_pin_m, self.child_pin_m))
        between = math.remainder(child - parent, 2.0 * math.pi)
        return [
            f"    l1_m: {math.hypot(*self.parent_pin_m):.5f}",
            f"    l2_m: {math.hypot(*self.child_pin_m):.5f}",
            f"    q0_rad: {between:.5f}",
            f"    x0_m: {self.closed_m:g}",
            f"    child_pin_angle_rad: {child:.5f}",
        ]


def edge_coefficient(flow_l_min: float, drop_bar: float) -> float:
    """Coefficient of one valve edge, m^3/(s sqrt(Pa)), from its nominal flow.

    Parameters
    ----------
    flow_l_min : float
        At full signal, l/min.
    drop_bar : float
        Over this one edge; a datasheet that gives both edges in series gives twice that.

    >>> round(edge_coefficient(100.0, 35.0) * 1e7, 2)
    8.91
    """
    return flow_l_min / 60e3 / math.sqrt(drop_bar * 1e5)


def hydraulics_text(
    urdf: Path,
    tip_link: str,
    cylinders: Sequence[MeasuredCylinder],
    valves: Sequence[tuple[float, float]],
    supply_bar: float,
    *,
    rated_voltage_v: float | None = None,
    rate_hz: float | None = None,
    pressure_range_bar: float | None = None,
) -> str:
    """A hydraulics file.

    Parameters
    ----------
    urdf : Path
        Beside the file; its name becomes the robot's.
    tip_link : str
    cylinders : sequence of MeasuredCylinder
    valves : sequence of (float, float)
        Of each cylinder's valve: nominal flow in l/min at a drop in bar over one edge.
    supply_bar : float
        Gauge.
    rated_voltage_v : float, optional
        Of the valves' full signal; the file does not state what is not known.
    rate_hz : float, optional
        Samples of the machine per second.
    pressure_range_bar : float, optional
        End of the pressure sensors' range, gauge.

    Returns
    -------
    str
    """
    lines = [f"robot: {urdf.stem}", f"urdf: {urdf.name}", f"tip_link: {tip_link}", "cylinders:"]
    lines += [line for one in cylinders for line in one.lines()]
    lines.append("valves:")
    rated = "" if rated_voltage_v is None else f"rated_voltage_v: {rated_voltage_v:g}, "
    for one, (flow, drop) in zip(cylinders, valves, strict=True):
        edge = edge_coefficient(flow, drop)
        edges = ", ".join(f"{name}: {edge:.3e}" for name in ("c_pa", "c_at", "c_pb", "c_bt"))
        lines += [
            f"  # {flow:g} l/min at {drop:g} bar over one edge",
            f"  - {{name: {one.joint}_valve, cylinder: {one.joint}_cylinder, {rated}{edges}}}",
        ]
    lines.append(f"supply: {{pressure_pa: {supply_bar * 1e5:.4e}}}")
    sensors = [] if rate_hz is None else [f"  rate_hz: {rate_hz:g}"]
    if pressure_range_bar is not None:
        sensors.append(f"  pressure: {{range_pa: {pressure_range_bar * 1e5:.4e}}}")
    lines += ["sensors:", *sensors] if sensors else []
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """`python -m hydro_model.new_robot`."""
    return run_command("new_robot", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    p = Parser(
        prog="new_robot",
        description="Write NAME.hydraulics.yaml beside NAME.urdf from pins and datasheets.",
        epilog="PX PY and CX CY: pins on the parent and on the child link, m from the joint's axis"
        " at q = 0, seen so that positive turns counter-clockwise, x along the child link; of a"
        " joint that slides x is along its axis, and the cylinder lies along it."
        " CLOSED: pin to pin, rod fully in.",
    )
    p.add_argument("urdf", type=Path, metavar="NAME.urdf", help="links, joints, limits, masses")
    p.add_argument("--tip", required=True, metavar="LINK", help="link at the tip")
    p.add_argument(
        "--cylinder",
        required=True,
        action="append",
        nargs=1 + len(_NUMBERS),
        metavar=("JOINT", *_NUMBERS),
        help="one for each joint with a cylinder; metres",
    )
    p.add_argument(
        "--valve",
        required=True,
        action="append",
        nargs=2,
        type=float,
        metavar=("L_MIN", "BAR"),
        help="nominal flow at a drop over one edge; once for all cylinders, or once for each of"
        " them in their order",
    )
    p.add_argument("--supply", required=True, type=float, metavar="BAR", help="gauge")
    for name, (unit, what) in _OPTIONS.items():
        p.add_argument(name, type=float, metavar=unit, help=what)
    p.add_argument("--force", action="store_true", help="replace a file that is there already")
    return p


def _measured(words: Sequence[str], sliding: Collection[str]) -> MeasuredCylinder:
    try:
        px, py, cx, cy, bore, rod, stroke, closed = (float(word) for word in words[1:])
    except ValueError as error:
        raise RobotError(f"--cylinder {words[0]}: expected eight numbers in m, {error}") from error
    slides = words[0] in sliding
    return MeasuredCylinder(words[0], (px, py), (cx, cy), bore, rod, stroke, closed, slides)


def _valves(given: Sequence[Sequence[float]], cylinders: int) -> list[tuple[float, float]]:
    """The valve of each cylinder: one that was given serves all."""
    for valve in given:
        if min(valve) <= 0.0:
            found = " ".join(f"{number:g}" for number in valve)
            raise RobotError(f"--valve: expected numbers above 0, found {found}")
    if len(given) not in (1, cylinders):
        raise RobotError(
            f"--valve: expected one for all or one for each of the {cylinders} cylinders, found"
            f" {len(given)}"
        )
    valves = [(flow, drop) for flow, drop in given]
    return valves * cylinders if len(valves) == 1 else valves


def _ratings(options: argparse.Namespace) -> dict[str, float | None]:
    """What of the valves and sensors was given, for `hydraulics_text`."""
    given = {
        "rated_voltage_v": options.rated_voltage,
        "rate_hz": options.rate,
        "pressure_range_bar": options.pressure_range,
    }
    for option, value in zip(_OPTIONS, given.values(), strict=True):
        if value is not None and not 0.0 < value < math.inf:
            raise RobotError(f"{option}: expected a number above 0, found {value:g}")
    usual = Sensors().pressure_range_pa / 1e5
    if options.pressure_range is None and options.supply > usual:
        raise RobotError(
            f"--supply: {options.supply:g} bar are beyond the {usual:g} bar to which pressure"
            " sensors are taken to read: give the end of their range with --pressure-range BAR"
        )
    return given


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    from hydro_model.description.urdf import read_chain
    from hydro_model.robot_files import load_robot

    out = options.urdf.with_suffix(".hydraulics.yaml")
    if not options.urdf.is_file():
        raise RobotError(f"no URDF '{options.urdf}'")
    if out.exists() and not options.force:
        raise RobotError(f"{out} is there already: move it away, or replace it with --force")
    chain = read_chain(options.urdf, options.tip)
    sliding = [joint.name for joint in chain.joints if joint.prismatic]
    cylinders = [_measured(words, sliding) for words in options.cylinder]
    valves = _valves(options.valve, len(cylinders))
    text = hydraulics_text(
        options.urdf, options.tip, cylinders, valves, options.supply, **_ratings(options)
    )
    # Read under another name: what does not fit leaves no file, and one that is there as it was.
    fresh = out.with_name(f".{out.name}.new")
    write_text(fresh, text)
    try:
        load_robot(fresh, check_strokes=False)
    except RobotError as error:
        raise RobotError(str(error).replace(str(fresh), str(out))) from error
    else:
        write_text(out, text)
    finally:
        fresh.unlink(missing_ok=True)
    print(out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
