"""How long a diagnosis of a long bag takes, until it has located and named and as a whole.

The bag is of the crane xs031 in closed loop with two effects that its robot file does not list.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

from hydro_ident.bench.job import Row, against_limit
from hydro_ident.errors import IdentError
from hydro_ident.study.long_bag import ROBOT, write_repeated
from hydro_ident.study.peak import spent
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

MINUTES = 10.0
#: What is there and not in the robot file.
EFFECTS = (
    EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0}),
    EffectSpec("valve_null_bias", "tilt_valve", {"bias": 0.006}),
)
#: With this stage a diagnosis has located and named, and verified both on held-out rows.
NAMED_BEFORE = "describing what has no name"
_NAMED_S, _WHOLE_S, _PEAK_MB = 60.0, 300.0, 1500e6 / 2**20


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """A diagnosis in a process of its own.

    Attributes
    ----------
    named_s, seconds : float
        From the process' start until located, named and verified; until its end.
    peak_mb : float
    names : tuple of str
        Effects that it found, most likely names.
    """

    named_s: float
    seconds: float
    peak_mb: float
    names: tuple[str, ...]


def diagnosed(folder: Path, minutes: float) -> Diagnosed:
    """Write a bag, diagnose it.

    Parameters
    ----------
    folder : Path
        For the bag and the results.
    minutes : float
        Of the bag.

    Raises
    ------
    IdentError
        The diagnosis failed.
    """
    bag, out, stages = folder / "diagnosed", folder / "diagnosis", folder / "stages.json"
    machine = replace(load_robot(ROBOT), effects=EFFECTS)
    write_repeated(bag, synthetic_recording(machine, 60.0 * minutes, seed=1), 1)
    words = [str(stages), str(bag), "--robot", ROBOT, "--out", str(out)]
    one = spent("hydro_ident.bench.diagnose_jobs", words)
    named = json.loads(stages.read_text(encoding="utf-8"))[NAMED_BEFORE] - one.begun_s
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    names = tuple(finding["names"][0] for finding in result["findings"])
    return Diagnosed(named, one.seconds, one.peak_mb, names)


def diagnose_rows(folder: Path, minutes: float = MINUTES) -> list[Row]:
    """Time until located and named, whole time and peak memory against their limits.

    Parameters
    ----------
    folder : Path
        For the bag and the results.
    minutes : float
        Of the bag.

    Raises
    ------
    IdentError
        The diagnosis failed, or did not name what is there: its time is worth nothing then.
    """
    one = diagnosed(folder, minutes)
    if missed := {effect.name for effect in EFFECTS}.difference(one.names):
        raise IdentError(f"expected findings {', '.join(sorted(missed))}, found {one.names}")
    name = f"diagnose, {minutes:g}-minute bag"
    peak = f"{name}: peak memory of the process, MiB"
    return [
        against_limit(f"{name}: located and named", "60 s", one.named_s, _NAMED_S),
        against_limit(f"{name}: in all", "300 s", one.seconds, _WHOLE_S),
        against_limit(peak, "1.5 GB", one.peak_mb, _PEAK_MB),
    ]


def _listened(stages: Path, arguments: list[str]) -> int:
    """The command itself, with the times at which its stages began written down."""
    from hydro_ident.commands.diagnose import run
    from hydro_model.command_line.terminal import progress_heard

    begun: dict[str, float] = {}

    def hear(what: str, _done: int, _total: int) -> None:
        begun.setdefault(what, time.monotonic())

    with progress_heard(hear):
        code = run(arguments)
    stages.write_text(json.dumps(begun), encoding="utf-8")
    return code


if __name__ == "__main__":
    sys.exit(_listened(Path(sys.argv[1]), sys.argv[2:]))
