"""Packages import one way: each only what stands before it in the order of the work."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import hydro_ident

FOLDER = Path(hydro_ident.__file__).parent
#: Packages and modules, as architecture.md has them.
ORDERS = {
    "": (
        *("errors", "everyday_units", "json_numbers", "transducers", "optional", "bag", "logs"),
        *("robots", "inspecting", "estimate", "parameters", "recordings", "rollouts", "design"),
        *("identify", "mismatch", "report", "commands", "study", "bench"),
    ),
    "estimate": ("bodies", "statistics", "signals", "forces", "flows", "scoring", "effects"),
    "mismatch": (
        *("settings", "rows", "fitting", "trials", "split", "locating", "naming", "verifying"),
        *("modelling", "unnamed", "answer"),
    ),
}


def _imported(path: Path, parent: str) -> set[str]:
    """Parts of a package that a module imports from, at its head or in functions."""
    prefix = f"hydro_ident.{parent}." if parent else "hydro_ident."
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {n.removeprefix(prefix).split(".")[0] for n in names if n.startswith(prefix)}


@pytest.mark.parametrize(
    ("parent", "part"), [(parent, part) for parent, order in ORDERS.items() for part in order]
)
def test_a_part_imports_what_stands_before_it(parent: str, part: str) -> None:
    folder, order = FOLDER / parent, ORDERS[parent]
    before = set(order[: order.index(part) + 1])
    own = [*(folder / part).rglob("*.py"), *folder.glob(f"{part}.py")]
    assert own
    assert not {p.name: late for p in own if (late := _imported(p, parent) - before)}


@pytest.mark.parametrize("parent", ORDERS)
def test_every_part_has_its_place(parent: str) -> None:
    folders = {p.parent.name for p in (FOLDER / parent).glob("*/__init__.py")}
    files = {p.stem for p in (FOLDER / parent).glob("*.py")} - {"__init__"}
    assert folders | files == set(ORDERS[parent])
