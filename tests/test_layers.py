"""Packages import one way: each only what stands before it in the order of the work."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: Where packages lie whose parts have an order.
FOLDERS = {
    "hydro_model": ROOT / "ros2_ws/src/hydro_model/hydro_model",
    **{
        n: ROOT / n / n
        for n in ("hydro_hw_bridge", "hydro_msgs_docs", "hydro_control", "hydro_ident")
    },
}
#: Parts of packages, packages and modules, as architecture.md has them.
ORDERS: Mapping[str, Sequence[str]] = {
    "hydro_model": (
        *("arrays", "errors", "robot", "numerics", "hydraulics", "multibody", "description"),
        *("effects", "robot_files", "command_line", "new_robot", "motion", "simulation"),
    ),
    "hydro_hw_bridge": (
        *("errors", "protocol", "bus", "gate", "monitoring", "core", "node"),
        *("commissioning", "rig", "faults"),
    ),
    "hydro_control": (
        *("errors", "gains", "state", "motion", "compensation", "adaptation", "law"),
        *("monitoring", "core", "node"),
    ),
    "hydro_ident": (
        *("errors", "everyday_units", "json_numbers", "transducers", "optional", "bag", "logs"),
        *("robots", "inspecting", "estimate", "parameters", "recordings", "rollouts", "design"),
        *("identify", "mismatch", "report", "commands", "study", "bench"),
    ),
    "hydro_ident.estimate": (
        *("bodies", "statistics", "signals", "forces", "flows", "scoring", "effects"),
    ),
    "hydro_ident.mismatch": (
        *("settings", "rows", "fitting", "trials", "split", "locating", "naming", "verifying"),
        *("modelling", "unnamed", "answer"),
    ),
}
#: What packages import of one another, as the first table of architecture.md has it.
REACH: Mapping[str, set[str]] = {
    "hydro_model": set(),
    "hydro_msgs_docs": {"hydro_model"},
    "hydro_hw_bridge": {"hydro_model", "hydro_msgs_docs"},
    "hydro_control": {"hydro_model", "hydro_msgs_docs"},
    "hydro_ident": {"hydro_model", "hydro_msgs_docs", "hydro_control"},
}
#: Of hydro_ident: they put all the others side by side.
SIDE_BY_SIDE = ("study", "bench")


def folder_of(package: str) -> Path:
    """Where a package lies, by its dotted name."""
    top, *below = package.split(".")
    return FOLDERS[top].joinpath(*below)


def imported(path: Path, package: str) -> set[str]:
    """Parts of a package that a module imports from, at its head or in functions."""
    prefix = f"{package}."
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.module, f"{path}: relative imports hide what they reach"
            assert not node.level, f"{path}: relative imports hide what they reach"
            # `from package import part` names the part last.
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {n.removeprefix(prefix).split(".")[0] for n in names if n.startswith(prefix)}


def too_early(folder: Path, package: str, order: Sequence[str]) -> dict[str, set[str]]:
    """Modules of a package that import what stands behind their part in the order, and what."""
    found = {}
    for place, part in enumerate(order):
        for path in (*(folder / part).rglob("*.py"), *folder.glob(f"{part}.py")):
            if late := imported(path, package) - set(order[: place + 1]):
                found[str(path.relative_to(folder))] = late
    return found


@pytest.mark.parametrize("package", ORDERS)
def test_a_part_imports_what_stands_before_it(package: str) -> None:
    assert too_early(folder_of(package), package, ORDERS[package]) == {}


@pytest.mark.parametrize("package", ORDERS)
def test_every_part_has_its_place(package: str) -> None:
    folder = folder_of(package)
    folders = {p.parent.name for p in folder.glob("*/__init__.py")}
    files = {p.stem for p in folder.glob("*.py")} - {"__init__"}
    assert sorted(folders | files) == sorted(ORDERS[package])


@pytest.mark.parametrize(
    "text",
    [
        "from one.late import thing",
        "from one.late.deep import thing",
        "from one import early, late",
        "import one.late.deep as deep",
        "def f():\n    from one.late import thing",
    ],
)
def test_an_import_against_the_order_is_told(text: str, tmp_path: Path) -> None:
    (tmp_path / "early").mkdir()
    (tmp_path / "early/module.py").write_text(f"from one.early import other\n{text}\n")
    (tmp_path / "late.py").write_text("from one.early.module import thing\nimport other.late\n")
    assert too_early(tmp_path, "one", ("early", "late")) == {"early/module.py": {"late"}}
    assert too_early(tmp_path, "one", ("late", "early")) == {"late.py": {"early"}}


@pytest.mark.parametrize("package", REACH)
def test_a_package_imports_the_others_that_the_table_says(package: str) -> None:
    folder, found = FOLDERS[package], dict[str, set[str]]()
    for path in folder.rglob("*.py"):
        place = path.relative_to(folder)
        apart = package == "hydro_ident" and place.parts[0] in SIDE_BY_SIDE
        names = re.findall(r"^ *(?:from|import) (hydro_\w+)", path.read_text("utf-8"), re.M)
        allowed = set(REACH) if apart else REACH[package] | {package}
        if late := set(names) & set(REACH) - allowed:
            found[str(place)] = late
    assert found == {}


def told(package: str, text: str) -> dict[str, list[str]]:
    """Modules by folder as a page's table of a package has them; "all" of a folder that is one."""
    place = FOLDERS[package].relative_to(ROOT).as_posix()
    row = rf"^\| \[`([\w/]+)/`\]\(\.\./{place}/\1/\) \| (all|(?:`\w+`(?:, )?)+) \| \S"
    found: dict[str, list[str]] = {}
    for folder, names in re.findall(row, text, re.M):
        found.setdefault(folder, []).extend(re.findall(r"\w+", names))
    return found


def forgotten(package: str, text: str) -> dict[str, set[str]]:
    """What a page leaves out of a package, or names and is not there, by folder."""
    section = text.partition(f"### `{package}`")[2].partition("\n##")[0]
    there: dict[str, set[str]] = {}
    for path in FOLDERS[package].rglob("*.py"):
        if path.stem != "__init__":
            folder = path.parent.relative_to(FOLDERS[package]).as_posix()
            there.setdefault(folder, set()).add(path.stem)
    tops = {name for name in there.pop(".") if f"`{name}.py`" not in section}
    named = told(package, text)
    wrong = {".": tops} | {
        folder: {"nothing of it"} if folder not in named else modules ^ set(named[folder])
        for folder, modules in there.items()
        if named.get(folder) != ["all"]
    }
    wrong |= {folder: {"no such folder"} for folder in set(named) - set(there)}
    return {folder: names for folder, names in wrong.items() if names}


@pytest.mark.parametrize("package", FOLDERS)
def test_the_map_names_every_folder_and_module(package: str) -> None:
    text = (ROOT / "hydro_msgs_docs/architecture.md").read_text(encoding="utf-8")
    assert forgotten(package, text) == {}
    for modules in told(package, text).values():
        assert len(modules) == len(set(modules))
    if package in ORDERS:
        parts = list(dict.fromkeys(folder.split("/")[0] for folder in told(package, text)))
        assert parts == [p for p in ORDERS[package] if (FOLDERS[package] / p).is_dir()]


def test_what_the_map_forgets_is_told() -> None:
    text = (ROOT / "hydro_msgs_docs/architecture.md").read_text(encoding="utf-8")
    less = text.replace("`kernel_following`, ", "").replace("`optional.py`", "")
    assert forgotten("hydro_hw_bridge", less) == {"rig": {"kernel_following"}}
    assert forgotten("hydro_ident", less) == {".": {"optional"}}
    less = re.sub(r"^\| \[`(bench|study/fuzz)/`.*\n", "", text, flags=re.M)
    one = {"nothing of it"}
    assert forgotten("hydro_ident", less) == {"bench": one, "study/fuzz": one}
    more = text.replace(
        "`logs/`](../hydro_ident/hydro_ident/logs/", "`log/`](../hydro_ident/hydro_ident/log/"
    )
    assert forgotten("hydro_ident", more) == {"logs": one, "log": {"no such folder"}}
