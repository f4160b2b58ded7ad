"""`scripts/golden.sh`: replay the golden bags, and compare or renew what is expected of them."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from hydro_ident.errors import IdentError
from hydro_model.command_line.command import Parser, run_command

KINDS = ("control", "diagnosis")
_SHOWN = 20


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="golden",
        description="Replay the golden bags through controller and diagnosis and compare every"
        " field with the committed references. Exit 0: as expected; 1: it differs.",
    )
    p.add_argument("kinds", nargs="*", metavar="KIND", help="control, diagnosis (default: both)")
    p.add_argument("--update", action="store_true", help="write the references anew")
    p.add_argument("--bags", action="store_true", help="make the bags anew before (and update)")
    p.add_argument("--folder", type=Path, required=True, help="folder of the golden files")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    unknown = [kind for kind in options.kinds if kind not in KINDS]
    if unknown or (options.bags and options.kinds):
        found = unknown[0] if unknown else "a KIND beside --bags, which is of both"
        raise IdentError(f"expected {' or '.join(KINDS)}, found {found}")
    if options.bags:
        from hydro_ident.study.golden.bags import make_bags

        make_bags(options.folder)
    update = options.update or options.bags
    return max(_replayed(kind, options.folder, update) for kind in options.kinds or KINDS)


def _replayed(kind: str, folder: Path, update: bool) -> int:
    from hydro_ident.study.golden.compare import differences
    from hydro_ident.study.golden.replay import REPLAYS

    found = json.loads(json.dumps(REPLAYS[kind](folder), allow_nan=False))
    path = folder / f"{kind}.json"
    if update:
        path.write_text(json.dumps(found, indent=None if kind == "control" else 1) + "\n")
        print(f"{kind}: written {path}")
        return 0
    if not path.is_file():
        raise IdentError(f"expected a reference {path}, found none (--update writes it)")
    differing = differences(kind, json.loads(path.read_text(encoding="utf-8")), found)
    rest = len(differing) - _SHOWN
    lines = differing[:_SHOWN] + ([f"and {rest} more"] if rest > 0 else [])
    print("\n".join(f"{kind}: {line}" for line in lines) or f"{kind}: as expected")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(run_command("golden", run))
