"""`scripts/faults.sh`: the fault campaign, measured at the rig's valves."""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError
from hydro_ident.study.faults import device_time, page, sources, wall_outcomes, wall_time
from hydro_ident.study.faults.wall_bus import BusDeeds
from hydro_ident.study.faults.wall_ends import EndDeeds
from hydro_ident.study.faults.wall_link import LinkDeeds
from hydro_ident.study.faults.wall_processes import ProcessDeeds
from hydro_ident.study.placed import write_result
from hydro_model.command_line.command import Parser, run_command
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.endings import on_end
from hydro_msgs_docs.middleware import DOMAIN, unused_domain

SCHEMA = "hydro_ident/faults/2"
PARTS = ("device_time", "wall_time")
#: What the identification node identifies from, in the repository.
BAG = "tests/golden/diagnosis_bag"
BESIDE = ("recorder", "identification", "send_path")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="faults",
        description="Put faults between machine, bridge and controller, and measure at the rig's"
        " valve input how each ends: most in device time, core to core and deterministic; a"
        " smaller part with real processes in wall time, beside a bare timer.",
    )
    p.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help="write the results there, and the tables of the page in the folder above it, if any;"
        " a part that was not run stays",
    )
    p.add_argument(
        "--injections", type=int, default=1200, metavar="N", help="in device time (%(default)s)"
    )
    p.add_argument(
        "--processes", type=int, default=305, metavar="N", help="in wall time (%(default)s)"
    )
    p.add_argument("--seed", type=int, default=0, help="the first (%(default)s)")
    p.add_argument(
        "--root", type=Path, default=Path(), metavar="DIR", help="repository (default: here)"
    )
    return p


def run(arguments: Sequence[str]) -> int:
    """Run the campaign; 0 where every promise was kept, 1 where one was not or none was tried."""
    options = parser().parse_args(arguments)
    if min(options.injections, options.processes) < 0:
        raise IdentError("expected numbers of injections of 0 or more")
    if not options.injections + options.processes:
        raise IdentError("expected at least one injection, in device time or in wall time")
    root: Path = options.root.resolve()
    done: dict[str, Any] = {}
    if options.injections:
        done["device_time"] = _in_device_time(options.injections, options.seed) | _made(root)
    if options.processes:
        done["wall_time"] = _in_wall_time(options.processes, options.seed, root)
        done["wall_time"] |= _made(root, wall=True)
    result = _result({"seed": options.seed, **_earlier(options.json), **done}, root)
    if options.json is not None:
        write_result(options.json, result, page.PAGE, page.with_tables)
    print(page.told(result))
    broken = any(part["broken"] for part in done.values())
    nothing = any(not part["injections"] for part in done.values())
    return 1 if broken or nothing else 0


def _made(root: Path, *, wall: bool = False) -> dict[str, Any]:
    """When a part was run, and of which sources."""
    date = datetime.now(timezone.utc).date().isoformat()
    return {"date": date, "sources": sources.digests(root, wall=wall)}


def _earlier(path: Path | None) -> dict[str, Any]:
    """The parts of an earlier run, which stay where they are not run again."""
    if path is None or not path.is_file():
        return {}
    found = json.loads(path.read_text(encoding="utf-8"))
    return {key: found[key] for key in PARTS if key in found and found["schema"] == SCHEMA}


def _result(parts: Mapping[str, Any], root: Path) -> dict[str, Any]:
    """What is written: parts that were not run now say what has changed since."""
    result = {"schema": SCHEMA, **parts}
    for key in PARTS:
        if key in result:
            since = sources.changed(result[key]["sources"], root, wall=key == "wall_time")
            result[key] = {**result[key], "changed_since": since}
    return result


def _in_device_time(count: int, seed: int) -> dict[str, Any]:
    robot = load_robot("xs031")
    found = device_time.run(robot, range(seed, seed + count), _tell_device)
    return device_time.summary(found, 1.0 / robot.sensors.rate_hz)


def _tell_device(outcome: Any) -> None:
    if outcome.broken:
        print(f"{outcome.injection.fault}: {'; '.join(outcome.broken)}", flush=True)


def _in_wall_time(count: int, seed: int, root: Path) -> dict[str, Any]:
    from hydro_ident.study.faults.ros_end import RosEnd
    from hydro_ident.study.faults.stage import Stage

    # It clears trips and publishes commands: of no machine that somebody has brought up.
    os.environ[DOMAIN] = str(unused_domain())
    # Shared memory of a killed process may hold up the next: `network.md`.
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    # Its processes end with it, whatever ends it.
    on_end(lambda: sys.exit(143))
    robot = load_robot("xs031")
    limits = device_time.limits_of(robot)
    port = 20_000 + os.getpid() % 20_000
    buses = (f"udp_multicast:239.74.163.2:{port}", f"udp_multicast:239.74.163.2:{port + 1}")
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hydro-faults.") as folder:
        stage = Stage(Path(folder), robot)
        ros = RosEnd(limits)
        try:
            run_ = wall_time.WallRun(stage, ros, limits, buses)
            run_.begin()
            deeds = EndDeeds(run_).deeds() | run_.deeds() | BusDeeds(run_, robot).deeds()
            deeds |= LinkDeeds(run_).deeds() | ProcessDeeds(run_, root / BAG).deeds()
            found, left_out = _done(run_, list(deeds.values()), count, random.Random(seed))
            told = wall_outcomes.summary(found, stage, run_.unasked_trips, left_out)
            return told | {"minutes": (time.monotonic() - begin) / 60.0}
        finally:
            ros.close()
            stage.end()


def _done(
    run_: wall_time.WallRun,
    deeds: Sequence[Callable[[random.Random], wall_outcomes.WallOutcome]],
    count: int,
    source: random.Random,
) -> tuple[list[wall_outcomes.WallOutcome], int]:
    """Injections in turn, and how many tries were left out: each is tried until it can be judged.

    A computer that is too busy for a tenth of them is too busy to tell.
    """
    found: list[wall_outcomes.WallOutcome] = []
    left_out = 0
    while len(found) < count:
        try:
            found.append(deeds[len(found) % len(deeds)](source))
        except IdentError as error:
            # A computer too busy to drive, or to start a process in time.
            left_out += 1
            print(f"left out: {error}", flush=True)
            if left_out > max(count // 10, 3):
                raise
            run_.stage.end("controller", *BESIDE)
            run_.recover()
            continue
        print(_line(found[-1]), flush=True)
    return found, left_out


def _line(one: wall_outcomes.WallOutcome) -> str:
    stop = "drives on" if one.stop_ms is None else f"0 V after {one.stop_ms:.1f} ms"
    excused = f"; not judged, as tripped by a stall: {one.excused}" if one.excused else ""
    return f"{one.kind}: {stop}" + (f": {one.broken}" if one.broken else excused)


if __name__ == "__main__":
    sys.exit(run_command("faults", run))
