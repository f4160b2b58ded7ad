"""`nominal`: the datasheet robot to compare an identified one with.

As in the paper's Table IV it borrows the identified viscous friction, which no datasheet gives.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report

#: Of what `--json` writes.
SCHEMA = "hydro_ident/nominal/1"

#: Edge coefficients of 0.5 to 2000 l/min at 35 bar, as `robot_units` has them, with a margin.
_SMALLEST, _LARGEST = 1e-9, 1e-4


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="nominal",
        description="Write a datasheet robot that borrows an identified viscous friction.",
    )
    p.add_argument("--robot", required=True, help="the datasheet robot")
    p.add_argument(
        "--friction-from", required=True, metavar="MODEL", help="model.yaml of identify"
    )
    p.add_argument(
        "--edge-coefficient",
        type=float,
        metavar="C",
        help="one coefficient for every valve edge, m^3/(s sqrt(Pa)); 6.30e-7 is the paper's"
        " printed nominal (default: those of the datasheet robot)",
    )
    p.add_argument("--out", required=True, type=Path, metavar="FILE", help="model.yaml to write")
    add_json(p, "the file written and what it borrows")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    from hydro_ident.errors import IdentError
    from hydro_ident.identify.identified_robot import with_edge_coefficient, with_viscous_friction
    from hydro_ident.identify.model_file import write_model
    from hydro_model.robot_files import load_robot

    coefficient = options.edge_coefficient
    if coefficient is not None and not _SMALLEST <= coefficient <= _LARGEST:
        raise IdentError(
            f"expected an edge coefficient of {_SMALLEST:g} to {_LARGEST:g} m^3/(s sqrt(Pa)),"
            f" found {coefficient:g}; one in l/(min sqrt(bar)) is 18973666 times as large"
        )
    if options.out.exists():
        raise IdentError(f"{options.out} is already there; nothing is overwritten")
    identified = load_robot(options.friction_from)
    friction = {c.name: c.viscous_friction for c in identified.cylinders}
    robot = with_viscous_friction(load_robot(options.robot), friction)
    if coefficient is not None:
        robot = with_edge_coefficient(robot, coefficient)
    try:
        options.out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise IdentError(f"{options.out.parent}: cannot be made: {error.strerror}") from error
    write_model(robot, options.out)
    data = {
        "schema": SCHEMA,
        "files": [str(options.out)],
        "robot": robot.name,
        "viscous_friction_ns_m": friction,
        "edge_coefficient": coefficient,
    }
    report(options.json, data, str(options.out))
    return 0


def main() -> int:
    """Entry point."""
    return run_command("nominal", run)


if __name__ == "__main__":
    sys.exit(main())
