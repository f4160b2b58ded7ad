"""`scripts/faults.sh`: the fault campaign, measured at the rig's valves."""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from hydro_hw_bridge.endings import on_end
from hydro_ident.errors import IdentError
from hydro_ident.study.faults import device_time, page, wall_outcomes, wall_time
from hydro_ident.study.placed import write_result
from hydro_model.command import run_command
from hydro_model.robot_files import load_robot

SCHEMA = "hydro_ident/faults/1"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="faults",
        description="Put faults between machine, bridge and controller, and measure at the rig's"
        " valve input how each ends: most in device time, core to core and deterministic; a"
        " smaller part with real processes in wall time, beside a bare timer.",
    )
    p.add_argument("--json", type=Path, metavar="FILE", help="write the results there")
    p.add_argument(
        "--injections", type=int, default=1200, metavar="N", help="in device time (%(default)s)"
    )
    p.add_argument(
        "--processes", type=int, default=66, metavar="N", help="in wall time (%(default)s)"
    )
    p.add_argument("--seed", type=int, default=0, help="the first (%(default)s)")
    return p


def run(arguments: Sequence[str]) -> int:
    """Run the campaign; 0 where every promise was kept, 1 where one was not or none was tried."""
    options = parser().parse_args(arguments)
    if options.injections < 1 or options.processes < 0:
        raise IdentError("expected at least one injection in device time, and none below 0")
    robot = load_robot("xs031")
    result: dict[str, Any] = {
        "schema": SCHEMA,
        "date": datetime.now(timezone.utc).date().isoformat(),
        "seed": options.seed,
    }
    found = device_time.run(
        robot, range(options.seed, options.seed + options.injections), _tell_device
    )
    result["device_time"] = device_time.summary(found, 1.0 / robot.sensors.rate_hz)
    if options.processes:
        result["wall_time"] = _in_wall_time(options.processes, options.seed)
    if options.json is not None:
        write_result(options.json, result, page.PAGE, page.with_tables)
    print(page.told(result))
    broken = [result[key]["broken"] for key in ("device_time", "wall_time") if key in result]
    nothing = bool(options.processes) and not result["wall_time"]["injections"]
    return 1 if any(broken) or nothing else 0


def _tell_device(outcome: Any) -> None:
    if outcome.broken:
        print(f"{outcome.injection.fault}: {'; '.join(outcome.broken)}", flush=True)


def _in_wall_time(count: int, seed: int) -> dict[str, Any]:
    from hydro_ident.study.faults.ros_end import RosEnd
    from hydro_ident.study.faults.stage import Stage

    # Its processes end with it, whatever ends it.
    on_end(lambda: sys.exit(143))
    robot = load_robot("xs031")
    limits, source = device_time.limits_of(robot), random.Random(seed)
    port = 20_000 + os.getpid() % 20_000
    buses = (f"udp_multicast:239.74.163.2:{port}", f"udp_multicast:239.74.163.2:{port + 1}")
    found: list[wall_outcomes.WallOutcome] = []
    left_out = 0
    with tempfile.TemporaryDirectory(prefix="hydro-faults.") as folder:
        stage = Stage(Path(folder), robot)
        ros = RosEnd(limits)
        try:
            run_ = wall_time.WallRun(stage, ros, limits, buses)
            run_.begin()
            deeds = run_.deeds()
            for i in range(count):
                try:
                    found.append(deeds[i % len(deeds)](source))
                except IdentError as error:
                    # A computer too busy to drive, or to start a process in time.
                    left_out += 1
                    print(f"left out: {error}", flush=True)
                    stage.end("controller")
                    if not stage.running("bridge"):
                        run_.start_bridge()
                    continue
                print(_line(found[-1]), flush=True)
            return wall_outcomes.summary(found, stage, run_.unasked_trips, left_out)
        finally:
            ros.close()
            stage.end()


def _line(one: wall_outcomes.WallOutcome) -> str:
    stop = "drives on" if one.stop_ms is None else f"0 V after {one.stop_ms:.1f} ms"
    return f"{one.kind}: {stop}" + (f": {one.broken}" if one.broken else "")


if __name__ == "__main__":
    sys.exit(run_command("faults", run))
