"""What a hidden process answers to one case: the diagnosis, then the baselines on the same rows.

Run as `python -m hydro_ident.study.answer`, with the arguments of `hydro_ident diagnose`. Of the
study it imports nothing: what made the recordings is out of its reach.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydro_model.command_line.command import run_command

if TYPE_CHECKING:
    from hydro_ident.mismatch.naming.baselines import BaselineFinding
    from hydro_ident.mismatch.split.residuals import Residuals

BASELINES_FILE, TIMES_FILE = "baselines.json", "times.json"


def baseline_result(found: Sequence[BaselineFinding]) -> dict[str, Any]:
    """A baseline's names in the form of the diagnosis' result, to be scored alike.

    Parameters
    ----------
    found : sequence of BaselineFinding

    Returns
    -------
    dict
        `verdict`, `findings` (each a set of one name) and `unexplained`, which is always empty.
    """
    findings = [
        {
            "channel": one.channel,
            "also": [],
            "target": one.target,
            "names": [one.name],
            "probability": [1.0],
            "parameters": [],
        }
        for one in found
    ]
    return {
        "verdict": "explained" if findings else "matches",
        "findings": findings,
        "unexplained": [],
    }


def baselines_of(work: Residuals | None) -> dict[str, Any]:
    """Both baselines on what the diagnosis looked at; `seconds` each, of processor time.

    One that breaks down has no answer, and an `error`.
    """
    import numpy as np

    from hydro_ident.errors import IdentError
    from hydro_ident.mismatch.naming.baselines import always_coulomb, greedy_bic

    chosen: dict[str, Callable[[Residuals], tuple[BaselineFinding, ...]]] = {
        "greedy_bic": greedy_bic,
        "always_coulomb": always_coulomb,
    }
    found: tuple[BaselineFinding, ...]
    answers = dict[str, Any]()
    for name, baseline in chosen.items():
        start = time.process_time()
        found, error = (), ""
        try:
            found = () if work is None else baseline(work)
        except (IdentError, np.linalg.LinAlgError) as failure:
            error = str(failure)
        answers[name] = {**baseline_result(found), "error": error}
        answers[name]["seconds"] = time.process_time() - start
    return answers


def run(arguments: Sequence[str]) -> int:
    """Body of the program; returns the diagnosis' exit code."""
    from hydro_ident.commands.diagnose import diagnosed, parser

    own = parser()
    # Cases are diagnosed side by side already, and each one's time is that of this process.
    own.set_defaults(processes=1)
    options = own.parse_args(arguments)
    start = time.process_time()
    code, found = diagnosed(options)
    times = {"diagnosis_cpu_s": time.process_time() - start}
    out: Path = options.out
    (out / TIMES_FILE).write_text(json.dumps(times), encoding="utf-8")
    text = json.dumps(baselines_of(found.work), indent=1)
    (out / BASELINES_FILE).write_text(text, encoding="utf-8")
    return code


def main() -> int:
    """Entry point of `python -m hydro_ident.study.answer`."""
    return run_command("answer", run)


if __name__ == "__main__":
    sys.exit(main())
