"""`sim_rig`: the simulated machine as a process on the bus."""

from __future__ import annotations

import argparse
import contextlib
import signal
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.payload import payload_argument
from hydro_model.command_line.command import Parser, run_command
from hydro_msgs_docs.endings import on_end

if TYPE_CHECKING:
    from hydro_hw_bridge.rig.core import RigCore
    from hydro_hw_bridge.rig.device import Device

INPUTS = {
    "emergency_stop": "emergency_stop_ok",
    "pump": "pump_on",
    "enable": "enable_switch",
}


def main() -> int:
    """Entry point of the executable."""
    return run_command("sim_rig", run)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="sim_rig",
        description="The simulated machine as a device on the CAN bus: encoders, pressures,"
        " valves. It is no ROS node; its true states go to a side file only.",
        epilog="SIGUSR1 turns all permissive inputs on, SIGUSR2 opens the emergency stop; Ctrl-C"
        ", SIGTERM and SIGHUP end it.",
    )
    add = parser.add_argument
    add("--robot", default="xs031", help="robot file or name of a shipped robot (%(default)s)")
    add(
        "--truth",
        default="realistic",
        metavar="NAME|FILE",
        help="what the machine really is: realistic, ideal, random:SEED or a file (%(default)s)",
    )
    add(
        "--can",
        metavar="BUS",
        help="interface:channel[:port], as socketcan:can0 or udp_multicast:239.74.163.2:43113",
    )
    add("--mapping", metavar="FILE", help="mapping of the bus (default: shipped for the robot)")
    add("--dbc", metavar="FILE", help="DBC (default: the one that the mapping names)")
    clock = parser.add_mutually_exclusive_group()
    clock.add_argument(
        "--lockstep",
        action="store_true",
        help="each cycle waits for the valve frame that answers it (default)",
    )
    clock.add_argument("--real-time", action="store_true", help="cycles are paced by the clock")
    add("--seed", type=_natural, default=0, help="of the sensor noise (%(default)s)")
    pose = parser.add_mutually_exclusive_group()
    pose.add_argument(
        "--tip", type=float, nargs=3, metavar=("X", "Y", "Z"), help="initial tip position, m"
    )
    pose.add_argument(
        "--joints", type=float, nargs="+", metavar="Q", help="initial joint positions, rad or m"
    )
    add(
        "--payload",
        type=payload_argument,
        nargs="+",
        default=[],
        metavar="KG@S",
        help="point mass at the tip from this device time since the first drive on, each in place"
        " of the one before: 50@6 0@12 takes 50 kg up and sets them down",
    )
    add("--truth-out", type=Path, metavar="FILE.npz", help="side file of true states")
    end = parser.add_mutually_exclusive_group()
    end.add_argument("--cycles", type=_natural, help="end after this many cycles")
    end.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="end after this device time since the first drive",
    )
    add(
        "--off",
        nargs="+",
        choices=sorted(INPUTS),
        default=[],
        help="permissive inputs that are off at the start",
    )
    add("--first-counter", type=_natural, default=0, help="sample counter at start (%(default)s)")
    return parser


def _natural(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a whole number of 0 or more, found '{text}'")
    return int(text)


def run(arguments: Sequence[str]) -> int:
    """Run the rig; returns the exit code.

    Raises
    ------
    HydroError
        Bad usage, an unreadable file or an absent bus.
    """
    options = _parser().parse_args(arguments)
    # Imported here so that --help is quick: these compile and load the codec.
    from hydro_hw_bridge.bus.bus_name import DEFAULT_BUS
    from hydro_hw_bridge.bus.bus_open import open_bus, quiet_python_can
    from hydro_hw_bridge.protocol.codec import Codec
    from hydro_hw_bridge.rig.device import Device, refuse_second_device
    from hydro_hw_bridge.rig.truth_log import TruthLog

    quiet_python_can()
    core = _core(options)
    robot, truth = core.robot, core.truth
    codec = Codec.load(options.dbc, options.mapping, robot)
    driven = _driven_cycles(options.duration, core.cycle_s)
    name = options.can or DEFAULT_BUS
    with open_bus(name, codec.device_ids) as bus:
        refuse_second_device(bus, codec)
    with open_bus(name, codec.bridge_ids) as bus, contextlib.ExitStack() as stack:
        log = None
        if options.truth_out is not None:
            facts = _facts(options, core)
            log = stack.enter_context(TruthLog(options.truth_out, core.truth_names, facts))
        device = Device(core, codec, bus, lockstep=not options.real_time, log=log)
        _handle_signals(device)
        clock = "real time" if options.real_time else "lockstep"
        rate_hz = 1.0 / core.cycle_s
        print(
            f"sim_rig: ready on {bus.name}: {robot.name}, truth {truth.name}, {clock},"
            f" {rate_hz:g} Hz",
            flush=True,
        )
        stack.callback(lambda: print(_summary(device), flush=True))
        device.run(options.cycles, driven)
    return 0


def _facts(options: Any, core: RigCore) -> dict[str, Any]:
    """What the side file says of the run."""
    facts = {"robot": core.robot.name, "truth": core.truth.name, "seed": options.seed}
    loads = [{"mass_kg": p.mass_kg, "from_s": p.from_s} for p in options.payload]
    return facts | ({"payloads": loads} if loads else {})


def _core(options: Any) -> RigCore:
    from hydro_hw_bridge.rig.core import Inputs, RigCore
    from hydro_hw_bridge.rig.truth_files import load_truth
    from hydro_model.robot_files import load_robot

    robot = load_robot(options.robot)
    off = {INPUTS[name]: False for name in options.off}
    return RigCore(
        robot,
        load_truth(options.truth, robot),
        seed=options.seed,
        q=options.joints,
        tip_m=options.tip,
        inputs=Inputs(**off),
        first_counter=options.first_counter,
        payloads=options.payload,
    )


def _driven_cycles(duration_s: float | None, cycle_s: float) -> int | None:
    if duration_s is None:
        return None
    if not 0.0 < duration_s < float("inf"):
        raise BridgeError(f"--duration: expected seconds above 0, found {duration_s:g}")
    return max(1, round(duration_s / cycle_s))


def _handle_signals(device: Device) -> None:
    def stop() -> None:
        device.stopping = True

    def inputs_on(number: int, frame: FrameType | None) -> None:
        device.core.set_inputs(emergency_stop_ok=True, pump_on=True, enable_switch=True)

    def press_stop(number: int, frame: FrameType | None) -> None:
        device.core.set_inputs(emergency_stop_ok=False)

    on_end(stop)
    signal.signal(signal.SIGUSR1, inputs_on)
    signal.signal(signal.SIGUSR2, press_stop)


def _summary(device: Device) -> str:
    c, core = device.counters, device.core
    return (
        f"sim_rig: {c.cycles} cycles ({c.cycles * core.cycle_s:.3f} s), {c.repeats} repeats,"
        f" {core.amplifier.trips} watchdog trips, {c.stale} stale and {c.corrupt} corrupt frames,"
        f" {c.missed} missed, {c.late} late, {c.slips} clock slips"
    )
