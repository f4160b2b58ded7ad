"""The packages are what colcon, rosdep and ament's linters take them for."""

from __future__ import annotations

import ast
import sys
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest
from catkin_pkg.package import Package, parse_package

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = [
    ROOT / "ros2_ws/src/hydro_model",
    *(ROOT / n for n in ("hydro_msgs_docs", "hydro_hw_bridge", "hydro_control", "hydro_ident")),
]
#: rosdep's name of what a module is imported from, where it is another one.
KEYS = {
    "can": "python3-can",
    "cantools": "python3-cantools-pip",
    "hypothesis": "python3-hypothesis",
    "mcap": "python3-mcap-pip",
    "msgpack": "python3-msgpack",
    "numba": "python3-numba",
    "llvmlite": "python3-numba",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "urdf_parser_py": "urdfdom_py",
    "yaml": "python3-yaml",
}
#: rosdep has no key for these; scripts/setup.sh installs them.
WITHOUT_KEY = {"clarabel", "plotly"}
#: No key is known for sure, and an unknown one ends all of `rosdep install`: mcap brings both.
BROUGHT = {"lz4": "mcap", "zstandard": "mcap"}
#: Used where they are there; what cannot do without says so.
OPTIONAL = {"argcomplete", "distributed", "h5py", "pyarrow"}
#: Imported by python-can's udp_multicast, and message types that recorder and player load by name.
BY_NAME = {"python3-msgpack", "geometry_msgs", "trajectory_msgs"}
#: Folders that measure the packages and their tests: they want requirements-test.in.
FOR_DEVELOPERS = {"bench", "fuzz", "mutants", "sabotage"}

packages = pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)


def package(folder: Path) -> Package:
    warnings: list[str] = []
    parsed = parse_package(str(folder / "package.xml"), warnings=warnings)
    assert not warnings
    return parsed


def imported(folder: Path, below: str) -> set[str]:
    """Top names of what the modules below a package's folder import, or their functions."""
    found: set[str] = set()
    own = {folder.name}
    for path in (folder / below).rglob("*.py"):
        if FOR_DEVELOPERS & set(path.relative_to(folder).parts):
            continue
        found |= imported_by(path)
        own |= {path.stem} if below == "test" else set()
    return found - set(sys.stdlib_module_names) - own


@cache
def imported_by(path: Path) -> frozenset[str]:
    """Top names of what a module imports, at its head, inside functions or by importorskip."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.split(".")[0])
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "pytest.importorskip":
            found.add(ast.literal_eval(node.args[0]).split(".")[0])
    return frozenset(found)


def keys(names: set[str]) -> set[str]:
    """rosdep's names of what has one."""
    return {KEYS.get(name, name) for name in names - WITHOUT_KEY - OPTIONAL - set(BROUGHT)}


@packages
def test_package_names_what_it_imports_and_nothing_else(folder: Path) -> None:
    wanted = keys(imported(folder, folder.name))
    named = {dependency.name for dependency in package(folder).exec_depends}
    assert wanted - named == set(), "missing in package.xml"
    assert named - wanted - BY_NAME == set(), "not imported"


@packages
def test_package_names_what_its_tests_import_and_nothing_else(folder: Path) -> None:
    parsed = package(folder)
    runs_on = {dependency.name for dependency in parsed.exec_depends}
    named = {dependency.name for dependency in parsed.test_depends}
    wanted = keys(imported(folder, "test")) | {"python3-pytest"}
    assert wanted - named - runs_on == set(), "missing in package.xml"
    assert named - wanted == set(), "not imported by tests"
    assert named & runs_on == set(), "named twice"


@packages
def test_tests_do_without_what_has_no_key(folder: Path) -> None:
    for path in (folder / "test").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for name in imported_by(path) & (WITHOUT_KEY | OPTIONAL):
            assert f'importorskip("{name}' in text, f"{path}: {name}"


@packages
def test_what_has_no_key_comes_with_what_has_one(folder: Path) -> None:
    named = {dependency.name for dependency in package(folder).exec_depends}
    for name in imported(folder, folder.name) & set(BROUGHT):
        assert KEYS[BROUGHT[name]] in named
        assert name in (metadata.requires(BROUGHT[name]) or [])


@packages
def test_colcon_test_runs_pytest(folder: Path) -> None:
    # colcon-python falls back on unittest, which finds nothing and is content.
    text = (folder / "setup.py").read_text(encoding="utf-8")
    assert 'extras_require={"test": ["pytest"]}' in text
    assert "python3-pytest" in {dependency.name for dependency in package(folder).test_depends}


@packages
def test_licence_and_version_are_said_alike(folder: Path) -> None:
    parsed = package(folder)
    setup = (folder / "setup.py").read_text(encoding="utf-8")
    assert parsed.licenses == ["Apache-2.0"]
    assert f'version="{parsed.version}"' in setup
    licence = (folder / parsed.licenses[0].file).read_text(encoding="utf-8")
    assert licence == (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert licence.lstrip().startswith("Apache License\n")


def test_ament_flake8_finds_nothing_in_these_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    # Every package has such a test of its own, which `colcon test` runs, and run there, too.
    linter = pytest.importorskip("ament_flake8.main", reason="ament_flake8 is not installed")
    places = [str(ROOT / "tests"), str(ROOT / "conftest.py")]
    monkeypatch.chdir(ROOT / "tests")
    code, errors = linter.main_with_errors(argv=["--config", str(ROOT / ".flake8"), *places])
    assert code == 0, "\n".join(errors)


def test_ament_xmllint_where_it_is_installed() -> None:
    linter = pytest.importorskip("ament_xmllint.main")
    assert linter.main(argv=[str(folder / "package.xml") for folder in FOLDERS]) == 0


def bound_twice(source: str) -> list[str]:
    """Names that a module's own level binds more than once: the second is what all of it sees."""
    names: list[str] = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.append(node.name)
        elif isinstance(node, ast.Assign):
            found = (n for target in node.targets for n in ast.walk(target))
            names += [
                n.id for n in found if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
            ]
    return sorted({name for name in names if names.count(name) > 1})


@packages
def test_no_module_gives_a_name_two_meanings(folder: Path) -> None:
    assert bound_twice("A = 1\n\n\ndef f(): ...\n\n\nB, A = 2, 3\n") == ["A"]
    twice = {str(p): found for p in folder.rglob("*.py") if (found := bound_twice(p.read_text()))}
    assert not twice
