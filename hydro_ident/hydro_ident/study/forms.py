"""Short forms of what has no name, on cases of a study that lie outside the catalogue.

The search for names is left out: what is described is what the refitted base leaves. The truth is
drawn again from the case's seed, and read only after the form.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_model.command_line.command import Parser, run_command

#: What an axis's hidden physics repeats by: radians of a turn per unit of its variable.
_RATES = ("vibration_rate", "ripple_count", "stiffness_count", "hum_rate", "drag_rate")


def described(case: Path) -> list[str]:
    """Every unexplained dependence of a case's folder and its forms, as lines."""
    from hydro_ident.identify.survey import survey_source
    from hydro_ident.mismatch.locating.locate import dependences
    from hydro_ident.mismatch.settings import DiagnosisSettings
    from hydro_ident.mismatch.split.residuals import residuals
    from hydro_ident.mismatch.unnamed.describe import each_form, form_of, form_text
    from hydro_ident.mismatch.unnamed.unknown import unexplained
    from hydro_ident.mismatch.verifying.confirm import Confirmer
    from hydro_ident.recordings.sources import bag_source
    from hydro_model.robot_files import load_robot

    robot = load_robot(str(next(case.glob("*.hydraulics.yaml"))))
    train, check = (
        [bag_source(str(bag), robot) for bag in sorted((case / name).iterdir())]
        for name in ("train", "check")
    )
    surveys = [survey_source(source, robot) for source in (*train, *check)]
    work = residuals(robot, train, check, surveys, DiagnosisSettings())
    if work is None:
        return ["too few rows"]
    confirmer = Confirmer(work.training, work.check, work.base)
    left = dependences(work.training, work.base)
    lines = []
    for one in unexplained(work.training, work.base, left, confirmer.holds):
        form = form_of(work.training, work.base, confirmer, one.dependence)
        lines.append(one.text)
        lines += [f"    {form_text(f)}" for f in each_form(form)] or ["    no form"]
    return lines or ["nothing unexplained"]


def truth_text(out: Path, truth: Mapping[str, Any]) -> str:
    """What a case hides, with what it repeats by: drawn again from its seed.

    `truth` is what the generator wrote down.
    """
    import numpy as np

    from hydro_ident.study.generate import CaseSpec, make_case
    from hydro_ident.study.robots import study_robot

    seed, count = int(truth["seed"]), len(list((out / "robots").iterdir()))
    robots = [study_robot(out / "robots", seed, k) for k in range(count)]
    extras = make_case(CaseSpec(seed, truth["index"], truth["kind"]), robots).machine.truth.extras
    turns = [float(getattr(axis, name)) for axis in extras.axes for name in _RATES]
    turns += [
        float(extras.machine.supply_ripple_rate),
        *extras.sensors.encoder_swing_count.values(),
    ]
    periods = [2.0 * np.pi / t for t in turns if t]
    periods += [1.0 / hz for hz in extras.sensors.hum_hz.values()]
    return ", ".join(f"repeats every {p:.4g} (rad, m or s)" for p in periods)


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    from hydro_ident.study.conceal import read_json

    options = parser().parse_args(arguments)
    for path in sorted((options.out / "truth").glob("*.json")):
        truth = read_json(path)
        if truth["kind"] != "outside" or (options.cases and path.stem not in options.cases):
            continue
        lines = described(options.out / "cases" / path.stem)
        one = truth["effects"][0]
        again = "" if options.plain else truth_text(options.out, truth)
        print(f"{path.stem}: {one['name']} of {one['target']}, {one['size']:.4g} {one['unit']}"
              f" {one['stated_at']}, {one['ratio']:.0f} times its limit {again}")  # fmt: skip
        print("\n".join(f"    {line}" for line in lines), flush=True)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(prog="forms", description=__doc__)
    p.add_argument("out", type=Path, help="a study's folder")
    p.add_argument("--cases", nargs="+", default=[], metavar="CASE", help="only these")
    p.add_argument("--plain", action="store_true", help="do not draw the truth again")
    return p


def main() -> int:
    """Entry point."""
    return run_command("forms", run)


if __name__ == "__main__":
    sys.exit(main())
