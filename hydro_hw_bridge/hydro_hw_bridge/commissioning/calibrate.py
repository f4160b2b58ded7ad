"""`calibrate`: pressure zeros, encoder references and valve signs of one machine, on its bus."""

from __future__ import annotations

import argparse
import errno
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydro_hw_bridge.bus.bus_name import DEFAULT_BUS
from hydro_hw_bridge.errors import BridgeError, CalibrationError
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report
from hydro_msgs_docs.endings import on_end

if TYPE_CHECKING:
    from hydro_hw_bridge.commissioning.calibration_session import Session
    from hydro_hw_bridge.protocol.calibration import Calibration
    from hydro_hw_bridge.protocol.codec import Codec
    from hydro_model.robot import Robot

NAME = "calibrate"
MAX_SHARE_PERCENT = 5.0
#: Of what `--json` writes.
SCHEMA = "hydro_hw_bridge/calibrated/1"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return run_command(NAME, _main, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog=NAME,
        description="Measures one machine's pressure zeros (pump off, oil drained), encoder"
        " references (machine in a known pose) and valve signs (one valve at a time, at 5 % at"
        " most), and writes them into a dated file for can_bridge's parameter 'calibration'."
        " No bridge may be running on the bus.",
    )
    parser.add_argument("--robot", default="xs031", help="robot file or shipped name (xs031)")
    parser.add_argument("--can", default=DEFAULT_BUS, help=f"interface:channel ({DEFAULT_BUS})")
    parser.add_argument("--mapping", help="mapping file (the one shipped for the robot)")
    parser.add_argument("--dbc", help="DBC file (the one that the mapping names)")
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the file (.)")
    parser.add_argument("--from", dest="start", type=Path, metavar="FILE", help="update this one")
    parser.add_argument("--zeros", action="store_true", help="measure the pressure zeros")
    parser.add_argument(
        "--reference",
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="the machine stands at these joint positions, rad or m",
    )
    parser.add_argument(
        "--signs",
        action="store_true",
        help="measure the valve signs; needs the joints' references, of now or --from FILE",
    )
    parser.add_argument(
        "--turned",
        nargs="+",
        default=[],
        metavar="VALVE",
        help="these valves are known to be wired the other way round: --signs takes their -1",
    )
    parser.add_argument(
        "--percent", type=float, default=MAX_SHARE_PERCENT, help="of the rated voltage (5)"
    )
    parser.add_argument(
        "--wait", type=float, default=60.0, metavar="S", help="for pump and inputs (60)"
    )
    add_json(parser, "file, values and what was noted with them")
    return parser


def _main(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    if not (options.zeros or options.reference or options.signs):
        raise BridgeError("nothing to do: expected --zeros, --reference or --signs")
    if not 0.0 < options.percent <= MAX_SHARE_PERCENT:
        raise BridgeError(
            f"--percent should be above 0 and at most {MAX_SHARE_PERCENT:g},"
            f" found {options.percent:g}"
        )
    if not options.out.is_dir():
        raise BridgeError(f"--out should be a folder, found '{options.out}'")
    from hydro_hw_bridge.bus.bus_open import open_bus, quiet_python_can
    from hydro_hw_bridge.commissioning.calibration_session import Session
    from hydro_hw_bridge.protocol.codec import Codec
    from hydro_model.robot_files import load_robot

    on_end(_interrupt)
    quiet_python_can()
    robot = load_robot(options.robot)
    references = _references(options.reference, robot)
    for name in options.turned:
        if name not in robot.valve_names:
            raise BridgeError(
                f"--turned should name valves of robot {robot.name}"
                f" ({', '.join(robot.valve_names)}), found '{name}'"
            )
    codec = Codec.load(options.dbc, options.mapping, robot)
    start = _start(options.start, codec)
    if options.signs:
        _check_referenced(robot, {*references, *(start.position_offset if start else {})})
    ids = (*codec.device_ids, *codec.bridge_ids)
    with open_bus(options.can, ids) as bus:
        session = Session(bus, codec)
        try:
            content, notes = _measure(session, robot, options, references, start)
        finally:
            session.stop()
    file = _write(options.out, codec, content, notes)
    data = {"schema": SCHEMA, "file": str(file), "robot": robot.name, "notes": notes}
    report(options.json, {**data, **content}, str(file))
    return 0


def _interrupt() -> None:
    raise KeyboardInterrupt


def _references(words: Sequence[str], robot: Robot) -> dict[str, float]:
    references = {}
    for word in words:
        name, _, text = word.partition("=")
        joint = robot.joints[robot.joint_index(name)]
        try:
            value = float(text)
        except ValueError:
            raise BridgeError(
                f"--reference should be JOINT=VALUE with a number, found '{word}'"
            ) from None
        if not joint.lower <= value <= joint.upper:
            raise BridgeError(
                f"--reference {name} should be within its limits {joint.lower:g} to"
                f" {joint.upper:g}, found {text}"
            )
        references[name] = value
    return references


def _check_referenced(robot: Robot, referenced: set[str]) -> None:
    from hydro_hw_bridge.commissioning.calibration_steps import unreferenced

    if missing := unreferenced(robot, referenced):
        raise BridgeError(
            f"--signs needs a reference of every joint with a lever, found none of"
            f" {', '.join(missing)}: a wrong zero can turn the sign around; expected"
            f" {' '.join(f'{name}=VALUE' for name in missing)} after --reference, or --from a"
            " calibration that has it"
        )


def _start(path: Path | None, codec: Codec) -> Calibration | None:
    if path is None:
        return None
    from hydro_hw_bridge.protocol.calibration import calibrated_mapping, load_calibration

    calibration = load_calibration(path)
    calibrated_mapping(codec.mapping, calibration, codec.robot.name)
    return calibration


def _measure(
    session: Session,
    robot: Robot,
    options: argparse.Namespace,
    references: Mapping[str, float],
    start: Calibration | None,
) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """The measured values by section, on top of those of the calibration to start from."""
    from hydro_hw_bridge.commissioning import calibration_steps as steps

    zeros = dict(start.pressure_zero_pa) if start else {}
    offsets = dict(start.position_offset) if start else {}
    signs = dict(start.valve_sign) if start else {}
    notes: dict[str, Any] = {"updates": start.name} if start else {}
    if options.zeros:
        _say("pressure zeros: waiting for the pump to be off")
        steps.wait_for_inputs(session, pump_on=False, timeout_s=options.wait)
        measured, spread = steps.pressure_zeros(session)
        _say_zeros(measured, spread)
        zeros |= measured
        notes["pressure_std_pa"] = spread
    if references:
        _say("encoder references: the machine must stand still")
        found = steps.position_offsets(session, references)
        _say_offsets(found, robot)
        offsets |= found
        notes["reference"] = dict(references)
    if options.signs:
        _say("valve signs: waiting for emergency stop, enable and pump to allow driving")
        steps.wait_for_inputs(session, pump_on=True, timeout_s=options.wait)
        share = options.percent / 100.0
        turned = steps.valve_signs(session, robot, offsets, share, _say)
        _say("valve signs: " + ", ".join(f"{name} {sign:+d}" for name, sign in turned.items()))
        _refuse_turned(turned, options.turned)
        signs |= turned
    content: dict[str, dict[str, Any]]
    content = {"pressure_zero_pa": zeros, "position_offset": offsets, "valve_sign": signs}
    return content, notes


def _refuse_turned(signs: Mapping[str, int], known: Sequence[str]) -> None:
    """A valve that is turned is one cause of a -1, and the only one that the file corrects."""
    unknown = [name for name, sign in signs.items() if sign < 0 and name not in known]
    if unknown:
        raise CalibrationError(
            f"expected a positive voltage to extend the cylinder, found it retracted by"
            f" {', '.join(unknown)}: crossed hoses or swapped coils, or an encoder that counts the"
            " other way (sign of the joint in the mapping), which no valve's sign corrects. Watch"
            " the rod. Where it is the valve, and to stay so: --turned " + " ".join(unknown)
        )


def _say_zeros(zeros: Mapping[str, float], spread: Mapping[str, float]) -> None:
    _say("pressure zeros, gauge, mean and standard deviation of the readings:")
    for name, zero in zeros.items():
        _say(f"  {name:20s} {zero:+10.1f} Pa ({zero / 1e5:+.4f} bar)  {spread[name]:8.1f} Pa")


def _say_offsets(offsets: Mapping[str, float], robot: Robot) -> None:
    _say("encoder references, to add to the readings:")
    for name, offset in offsets.items():
        unit = "m" if robot.joints[robot.joint_index(name)].prismatic else "rad"
        _say(f"  {name:20s} {offset:+12.6f} {unit}")


def _write(folder: Path, codec: Codec, content: Mapping[str, Any], notes: dict[str, Any]) -> Path:
    """Write the dated file whole or not at all; never over another one."""
    from hydro_hw_bridge.protocol.calibration import Calibration, calibration_text, channels_hash

    robot, mapping = codec.robot.name, codec.mapping
    name = f"{time.strftime('%Y%m%d-%H%M%S')}_{robot}"
    path = folder / f"{name}.calibration.yaml"
    notes["date"] = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    of = {**content, "channels": channels_hash(mapping)}
    text = calibration_text(Calibration(name, robot, mapping.name, **of), notes)
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        _name(part, path)
    except OSError as error:
        raise BridgeError(f"cannot write '{path}': {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return path


def _name(part: Path, path: Path) -> None:
    """Give a written file its name, which no other one has."""
    try:
        os.link(part, path)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS):
            raise
        # A file system without links, such as FAT: what was measured is not to be lost for it.
        with open(path, "x"):
            os.replace(part, path)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
