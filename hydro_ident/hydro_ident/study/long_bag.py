"""Memory and time of `identify`, `diagnose` or `inspect` against the length of a bag.

    python -m hydro_ident.study.long_bag [--minutes 10 40 160] [--folder DIR]
        [--command diagnose|inspect] [--repeat BAG]

Writes a bag of each length (a 40 s run of the crane xs031, or another bag of it, repeated, 500 Hz,
four topics), runs the command on it in a process of its own and prints that process's peak memory
and time. Bags are removed again.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hydro_ident.bag.recording import Recording, read_recording
from hydro_ident.bag.writer import BagWriter
from hydro_ident.study.peak import Spent, spent
from hydro_ident.study.synthetic import START_NS, synthetic_recording
from hydro_model.command_line.command import Parser, run_command
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT, RUN_S, PERIOD_NS = "xs031", 40.0, 2_000_000
COMMANDS = ("identify", "diagnose", "inspect")


@dataclass(frozen=True, slots=True)
class Measured:
    """One length.

    Attributes
    ----------
    minutes, peak_mb, seconds : float
    bag_mb : float
        On disk.
    """

    minutes: float
    peak_mb: float
    seconds: float
    bag_mb: float


def topics_of(recording: Recording) -> dict[str, tuple[tuple[str, ...], dict[str, FloatArray]]]:
    """Names and fields by topic, pressures absolute, as a bag has them."""
    robot = recording.robot
    gauge = np.zeros((len(recording), len(robot.pressure_names)))
    if recording.p_a is not None and recording.p_b is not None:
        gauge[:, 0:-2:2], gauge[:, 1:-2:2] = recording.p_a, recording.p_b
    gauge[:, -2], gauge[:, -1] = recording.supply, recording.tank
    absolute = gauge + robot.atmospheric_pressure_pa
    volts = np.asarray(recording.valve_v)
    return {
        "/joint_states": (robot.joint_names, {"position": recording.q}),
        "/chamber_pressures": (robot.pressure_names, {"effort": absolute}),
        "/valve_state": (robot.valve_names, {"effort": volts}),
        "/joint_reference": (robot.joint_names, {"position": np.asarray(recording.q_ref)}),
    }


def write_repeated(path: Path, recording: Recording, repeats: int) -> None:
    """A recording as a bag, several times one after the other with a second's gap between.

    Parameters
    ----------
    path : Path
        Of the new bag.
    recording : Recording
        With pressures, voltages and references.
    repeats : int
    """
    count, topics = len(recording), topics_of(recording)
    with BagWriter(path, {"robot": recording.robot.name}) as writer:
        for topic in topics:
            writer.add_topic(topic, "sensor_msgs/msg/JointState")
        for k in range(count * repeats):
            stamp = START_NS + PERIOD_NS * k + 1_000_000_000 * (k // count)
            for topic, (names, fields) in topics.items():
                values = {f: v[k % count] for f, v in fields.items()}
                writer.write_stamped(topic, stamp, values, names=names)


def bag_of(minutes: float, folder: Path, recording: Recording | None = None) -> Path:
    """Write a bag of this length.

    Parameters
    ----------
    minutes : float
    folder : Path
        Gets it.
    recording : Recording, optional
        To repeat; by default a synthetic one.

    Returns
    -------
    Path
    """
    bag = folder / f"run_{minutes:g}"
    recording = recording or synthetic_recording(load_robot(ROBOT), RUN_S, seed=1)
    run_s = len(recording) * PERIOD_NS / 1e9
    write_repeated(bag, recording, max(1, round(60.0 * minutes / (run_s + 1.0))))
    return bag


def watched(command: str, bag: Path) -> Spent:
    """Run a command on a bag of `ROBOT`, its results into a folder beside the bag.

    Parameters
    ----------
    command : {"identify", "diagnose", "inspect"}
    bag : Path

    Raises
    ------
    IdentError
        The command failed.
    """
    words = [str(bag), "--robot", ROBOT]
    words += [] if command == "inspect" else ["--out", str(bag.with_name(f"{bag.name}_{command}"))]
    return spent(f"hydro_ident.commands.{command}", words)


def measure(
    minutes: float, folder: Path, command: str = "identify", recording: Recording | None = None
) -> Measured:
    """Write a bag of this length, run a command on it, remove it.

    Parameters
    ----------
    minutes : float
    folder : Path
    command : {"identify", "diagnose", "inspect"}
    recording : Recording, optional
        To repeat; by default a synthetic one.

    Raises
    ------
    IdentError
        The command failed.
    """
    bag = bag_of(minutes, folder, recording)
    size = sum(file.stat().st_size for file in bag.iterdir()) / 1e6
    one = watched(command, bag)
    shutil.rmtree(bag)
    return Measured(minutes, one.peak_mb, one.seconds, size)


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="long_bag", description=__doc__)
    parser.add_argument(
        "--minutes", type=float, nargs="+", default=[10.0, 40.0, 160.0], help="of the bags"
    )
    parser.add_argument("--folder", type=Path, help="where the bags go for a while")
    parser.add_argument("--command", choices=COMMANDS, default="identify", help="what is measured")
    parser.add_argument("--repeat", type=Path, help=f"a bag of {ROBOT} at 500 Hz to repeat")
    options = parser.parse_args(arguments)
    recording = options.repeat and read_recording(options.repeat, load_robot(ROBOT))
    print("| minutes | bag, MB | peak memory, MB | seconds |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for minutes in options.minutes:
            one = measure(minutes, Path(folder), options.command, recording)
            print(f"| {minutes:g} | {one.bag_mb:.0f} | {one.peak_mb:.0f} | {one.seconds:.0f} |")
            sys.stdout.flush()
    return 0


def main() -> int:
    """Entry point of `python -m hydro_ident.study.long_bag`."""
    return run_command("long_bag", _run)


if __name__ == "__main__":
    sys.exit(main())
