"""Cases on disk: recordings and robot file in one folder, the truth in another, diagnosed apart.

The diagnosis runs in a process of its own, in a temporary folder that holds copies of the case's
recordings and robot file and nothing else, and where the system can it is kept out of the study's
folder altogether (`seclusion`). The two baselines answer in the same process.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.study.answer import BASELINES_FILE, TIMES_FILE
from hydro_ident.study.bags import FIRST_S, SPAN_S, write_run
from hydro_ident.study.generate import Case, digest, truth_record
from hydro_ident.study.leaks import outward
from hydro_ident.study.planting import oil_temperature
from hydro_ident.study.seclusion import secluded

CASES, TRUTHS, ANSWERS, ORACLES = "cases", "truth", "answers", "oracle"
#: Where a case is written before it is whole.
PARTS = "parts"
RESULT_FILE = "result.json"
ANSWER = (sys.executable, "-m", "hydro_ident.study.answer")
_SECOND_NS = 1_000_000_000
#: What one diagnosis may take, s of wall time.
PATIENCE_S = 900.0


def write_case(case: Case, out: Path) -> None:
    """Write a case's recordings, robot file and truth; the truth last.

    Parameters
    ----------
    case : Case
    out : Path
        Of the study.
    """
    name, random = case.spec.name, case.spec.random(90)
    whole, folder = out / CASES / name, out / PARTS / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for file in case.robot.folder.glob("crane_*"):
        shutil.copy(file, folder / file.name)
    warm = bool(random.random() < 0.5)
    starts = FIRST_S + np.sort(random.integers(SPAN_S, size=2))
    index = case.planted[0].index if case.planted else 0
    for part, run, start in zip(("train", "check"), (case.train, case.check), starts, strict=True):
        seconds = np.arange(len(run.track.states) * run.track.cycle_s)
        temperature = oil_temperature(case.machine, index, seconds) if warm else None
        if temperature is not None:
            temperature = temperature + 0.1 * random.standard_normal(len(seconds))
        write_run(
            folder / part / digest("bag", name, part),
            run,
            seed=int(random.integers(1 << 31)),
            start_ns=int(start) * _SECOND_NS,
            temperature_c=temperature,
        )
    shutil.rmtree(whole, ignore_errors=True)
    whole.parent.mkdir(parents=True, exist_ok=True)
    # At once: a case's folder that is there is whole.
    os.replace(folder, whole)
    record = truth_record(case) | {"temperature_recorded": warm, "outward": outward(whole)}
    write_json(out / TRUTHS / f"{name}.json", record)


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file so that it is there whole or not at all.

    `content` is what JSON can say.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    partial.write_text(json.dumps(content, indent=1), encoding="utf-8")
    os.replace(partial, path)


def read_json(path: Path) -> dict[str, Any]:
    """A JSON mapping.

    Raises
    ------
    IdentError
        There is none.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise IdentError(f"{path}: expected a JSON file of the study, found: {error}") from error
    if not isinstance(content, dict):
        raise IdentError(f"{path}: expected a mapping, found {type(content).__name__}")
    return content


def diagnose_case(name: str, out: Path, command: Sequence[str] = ANSWER) -> dict[str, Any]:
    """Diagnose a case where its truth is not, and let the baselines answer, too.

    Parameters
    ----------
    name : str
        Of the case.
    out : Path
        Of the study.
    command : sequence of str
        Program of the diagnosis and its first arguments.

    Returns
    -------
    dict
        `exit`, `seconds` (of wall time), `cpu_seconds` (of the diagnosis alone, or None), `error`
        (last line of stderr), `secluded` (the system kept the process out of the study's folder),
        `result` (the result file's content, or None) and `baselines` (by name).

    Raises
    ------
    IdentError
        There is no such case, or the study's folder holds what the process needs.
    """
    needed = (Path(tempfile.gettempdir()), Path(sys.prefix), Path(__file__))
    if any(path.resolve().is_relative_to(out.resolve()) for path in needed):
        raise IdentError(
            f"{out}: expected a folder of the study's own, found software or temporary files in it"
        )
    source = out / CASES / name
    if not source.is_dir():
        raise IdentError(f"{source}: no such case, expected its recordings")
    with tempfile.TemporaryDirectory(prefix="recordings_") as folder:
        place = Path(folder)
        shutil.copytree(source, place / "in")
        answer = _run(place, command, out)
        answer["cpu_seconds"] = _read_or(place / "out" / TIMES_FILE, {}).get("diagnosis_cpu_s")
        answer["result"] = _read_or(place / "out" / RESULT_FILE, None)
        answer["baselines"] = _read_or(place / "out" / BASELINES_FILE, {})
    write_json(out / ANSWERS / f"{name}.json", answer)
    return answer


def _read_or(path: Path, otherwise: Any) -> Any:
    return read_json(path) if path.is_file() else otherwise


def _run(place: Path, command: Sequence[str], hide: Path) -> dict[str, Any]:
    robots = sorted((place / "in").glob("*.hydraulics.yaml"))
    train, check = (sorted((place / "in" / part).iterdir()) for part in ("train", "check"))
    arguments = [*command, *(str(b.relative_to(place)) for b in train)]
    arguments += ["--robot", str(robots[0].relative_to(place)), "--validate"]
    arguments += [str(b.relative_to(place)) for b in check]
    arguments += ["--out", "out"]
    apart = secluded(arguments, hide)
    environment = {k: v for k, v in os.environ.items() if k not in ("PWD", "OLDPWD")}
    environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    start = time.monotonic()
    try:
        done = subprocess.run(
            apart or arguments,
            cwd=place,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        code, error = done.returncode, done.stderr.strip().splitlines()[-1:]
    except subprocess.TimeoutExpired:
        code, error = -1, [f"not done within {PATIENCE_S:g} s"]
    return {
        "exit": code,
        "seconds": time.monotonic() - start,
        "error": " ".join(error),
        "secluded": apart is not None,
    }
