"""What discovered physics is worth at the tip: random machines, offline in closed loop.

    python -m hydro_ident.study.discovered --plants 20 --seed S --out FILE.json

Machines are `random_truth` of the rig with seeds 1000 S, 1000 S + 1, ...; those that leave less
than 10 % of the force along the path are passed over. Each is driven along the experiment of
`excite` with its datasheet model, `identify` and `diagnose` make their models of the recorded
bags in processes of their own, and the reference path is driven with the datasheet, the
identified and the discovered model. Then it is driven again with every discovered effect left out
of the controller, one name at a time. The file grows by a machine at a time, and what stands in
it, or in the folder of bags and models, is not done again.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from hydro_control.compensation.compensation_plan import plan
from hydro_control.gains import Gains
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import Truth
from hydro_ident.errors import IdentError
from hydro_ident.identify.identified_robot import with_viscous_friction
from hydro_ident.identify.results import CONTROLLER_FILE, RESULT_FILE
from hydro_ident.study.discovered_summary import (
    PAGE,
    RESULT,
    summary_lines,
    summary_of,
    with_table,
)
from hydro_ident.study.force_margin import Motion, force_margin, motion_along
from hydro_ident.study.gain_choice import track
from hydro_ident.study.machine_bags import design_experiment, model_of, record_runs
from hydro_ident.study.placed import renewed
from hydro_model.command_line.command import Parser, run_command
from hydro_model.motion.paths import TipPath, load_path
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

ROBOT, PATH = "xs031", "xs031/parallelogram"
SCHEMA = "hydro_ident/discovered/1"
LEAST_MARGIN = 0.10
#: Seeds per study: machines of different `--seed` are never the same.
SPAN = 1000
_TRACK_SEED = 3

Row = dict[str, float]


@dataclass(frozen=True, slots=True)
class Options:
    """What holds for every machine.

    Attributes
    ----------
    work : Path
        Bags and models of each machine stay here.
    experiment : Path
        Of `excite`.
    ablation : bool
    """

    work: Path
    experiment: Path
    ablation: bool = True


def machines(robot: Robot, path: TipPath, seed: int, count: int) -> Iterator[tuple[int, float]]:
    """Seeds and margins of the first machines with force to spare along the path.

    Raises
    ------
    IdentError
        The seed has too few of them.
    """
    found, motion = 0, motion_along(robot, path)
    for number in range(SPAN * seed, SPAN * (seed + 1)):
        if found == count:
            return
        margin = margin_of(robot, motion, number)
        if margin >= LEAST_MARGIN:
            found += 1
            yield number, margin
    if found < count:
        raise IdentError(f"seed {seed} has {found} machines with force to spare, not {count}")


def margin_of(robot: Robot, motion: Motion, number: int) -> float:
    """Force margin of a machine; 0 where it cannot even hold the path's start."""
    try:
        return force_margin(robot, random_truth(robot, number), motion)
    except BridgeError:
        return 0.0


def study_machine(options: Options, machine: tuple[int, float]) -> dict[str, Any]:
    """Record, identify, diagnose and drive one machine.

    Parameters
    ----------
    options : Options
    machine : (int, float)
        Seed and force margin.

    Returns
    -------
    dict
        An entry of `plants` of the result.
    """
    (seed, margin), robot = machine, load_robot(ROBOT)
    folder = options.work / f"machine_{seed}"
    truth, start = random_truth(robot, seed), _start_tip()
    bags = record_runs(robot, truth, options.experiment, start, folder)
    identified = load_robot(model_of("identify", ROBOT, bags, folder / "identified"))
    found_file = model_of("diagnose", ROBOT, bags, folder / "discovered")
    found = load_robot(found_file)
    gains, planned = gains_of(found_file.with_name(CONTROLLER_FILE)), plan(found)
    friction = {c.name: c.viscous_friction for c in identified.cylinders}
    rows = {
        "nominal": (with_viscous_friction(robot, friction), Gains()),
        "identified": (identified, Gains()),
        "discovered": (found, gains),
    }
    names = planned.names if options.ablation else ()
    ablated = {name: (without(found, name), gains) for name in names}
    return {
        "seed": seed,
        "force_margin": margin,
        "rows": driven(robot, truth, rows),
        "without": driven(robot, truth, ablated),
        "compensated": list(planned.names),
        "left_out": dict(planned.left_out),
        "command_delay_s": found.command_delay_s,
        "diagnosis": _diagnosis(found_file.with_name(RESULT_FILE)),
    }


def driven(robot: Robot, truth: Truth, cases: dict[str, tuple[Robot, Gains]]) -> dict[str, Row]:
    """Tracking figures of one machine along the path, by model and gains.

    `cases` are models with their gains, by name.
    """
    return {
        name: asdict(track(robot, truth, model, gains, _TRACK_SEED))
        for name, (model, gains) in cases.items()
    }


def without(robot: Robot, name: str) -> Robot:
    """A robot without the listed effects of a name."""
    return replace(robot, effects=tuple(e for e in robot.effects if e.name != name))


def gains_of(file: Path) -> Gains:
    """The gains of a `controller.yaml`.

    `file` is that.
    """
    parameters = yaml.safe_load(file.read_text(encoding="utf-8"))["controller"]["ros__parameters"]
    return Gains(**{name: parameters[name] for name in asdict(Gains())})


def _start_tip() -> tuple[float, ...]:
    return tuple(_path().sample(0.0)[0].tolist())


def _path() -> TipPath:
    path = load_path(PATH)
    if not isinstance(path, TipPath):
        raise IdentError(f"{PATH}: expected a path of the tip")
    return path


def _diagnosis(file: Path) -> dict[str, Any]:
    result = json.loads(file.read_text(encoding="utf-8"))
    keys = ("names", "probability", "target", "modelled_as", "parameters")
    return {
        "verdict": result["verdict"],
        "findings": [{key: one[key] for key in keys} for one in result["findings"]],
        "unexplained": [one["text"] for one in result["unexplained"]],
    }


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(prog="discovered", description=__doc__)
    p.add_argument("--plants", type=int, default=20, help="machines (%(default)s)")
    p.add_argument("--seed", type=int, required=True, help="which machines")
    p.add_argument("--jobs", type=int, default=1, help="processes (%(default)s)")
    p.add_argument("--out", type=Path, required=True, metavar="FILE.json", help="figures")
    p.add_argument("--work", type=Path, help="folder of bags and models (default: beside --out)")
    p.add_argument("--no-ablation", action="store_true", help="leave the ablation out")
    return p


def _run(arguments: Sequence[str]) -> int:
    p = parser()
    options = p.parse_args(arguments)
    for name in ("plants", "seed", "jobs"):
        if getattr(options, name) < 1:
            p.error(f"--{name}: expected 1 or more, found {getattr(options, name)}")
    work = options.work or options.out.with_suffix("")
    experiment = work / "experiment"
    work.mkdir(parents=True, exist_ok=True)
    design_experiment(ROBOT, _start_tip(), experiment)
    chosen = list(machines(load_robot(ROBOT), _path(), options.seed, options.plants))
    done = {one["seed"]: one for one in _earlier(options.out, options.seed)}
    left = [machine for machine in chosen if machine[0] not in done]
    case = partial(study_machine, Options(work, experiment, not options.no_ablation))
    command = ["python", "-m", "hydro_ident.study.discovered"]
    command += ["--plants", str(options.plants), "--seed", str(options.seed)]
    with ProcessPoolExecutor(options.jobs) as pool:
        for one in pool.map(case, left):
            done[one["seed"]] = one
            plants = [done[seed] for seed, _ in chosen if seed in done]
            _write(options.out, options.seed, shlex.join(command), plants)
            print(f"machine {one['seed']}: {_rho(one)}", flush=True)
    print("\n".join(summary_lines(json.loads(options.out.read_text(encoding="utf-8")))))
    if options.out.name == RESULT:
        renewed(options.out, PAGE, with_table)
    return 0


def _rho(one: dict[str, Any]) -> str:
    rows = one["rows"].items()
    return ", ".join(f"{n} {r['max_error_mm']:.2f} mm, rho {r['rho_s']:.4f} s" for n, r in rows)


def _earlier(file: Path, seed: int) -> list[dict[str, Any]]:
    if not file.is_file():
        return []
    data = json.loads(file.read_text(encoding="utf-8"))
    if data.get("schema") != SCHEMA or data.get("seed") != seed:
        raise IdentError(f"{file}: expected a result of seed {seed} to go on with")
    return list(data["plants"])


def _write(file: Path, seed: int, command: str, plants: list[dict[str, Any]]) -> None:
    data = {
        "schema": SCHEMA,
        "command": command,
        "date": datetime.now(timezone.utc).date().isoformat(),
        "seed": seed,
        "summary": summary_of(plants),
        "plants": plants,
    }
    part = file.with_suffix(".part")
    part.write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(part, file)


def main() -> int:
    """Entry point of `python -m hydro_ident.study.discovered`."""
    return run_command("discovered", _run)


if __name__ == "__main__":
    sys.exit(main())
