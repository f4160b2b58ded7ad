"""The diagnosis' packages import one way: each only what stands before it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import hydro_ident.mismatch

FOLDER = Path(hydro_ident.mismatch.__file__).parent
PREFIX = "hydro_ident.mismatch."
#: In the order of the work, as architecture.md has them.
ORDER = (
    *("settings", "rows", "fitting", "trials", "split", "locating", "naming", "verifying"),
    *("modelling", "unnamed", "answer"),
)


def _imported(path: Path) -> set[str]:
    """Packages of the diagnosis that a module imports from, at its head or in functions."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PREFIX):
            names.add(str(node.module).removeprefix(PREFIX).split(".")[0])
        elif isinstance(node, ast.Import):
            own = [a.name for a in node.names if a.name.startswith(PREFIX)]
            names |= {name.removeprefix(PREFIX).split(".")[0] for name in own}
    return names


@pytest.mark.parametrize("package", ORDER)
def test_a_package_imports_what_stands_before_it(package: str) -> None:
    before = set(ORDER[: ORDER.index(package) + 1])
    own = [p for p in FOLDER.rglob("*.py") if Path(p.relative_to(FOLDER).parts[0]).stem == package]
    assert own
    late = {p.name: sorted(_imported(p) - before) for p in own if _imported(p) - before}
    assert not late


def test_every_package_has_its_place() -> None:
    folders = {p.parent.name for p in FOLDER.glob("*/__init__.py")}
    files = {p.stem for p in FOLDER.glob("*.py")} - {"__init__"}
    assert folders | files == set(ORDER)
