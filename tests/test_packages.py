"""The packages are what colcon, rosdep and ament's linters take them for."""

from __future__ import annotations

import ast
import sys
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
    "lz4": "python3-lz4",
    "mcap": "python3-mcap-pip",
    "msgpack": "python3-msgpack",
    "numba": "python3-numba",
    "llvmlite": "python3-numba",
    "numpy": "python3-numpy",
    "scipy": "python3-scipy",
    "urdf_parser_py": "urdfdom_py",
    "yaml": "python3-yaml",
    "zstandard": "python3-zstandard",
}
#: rosdep has no key for these; scripts/setup.sh installs them.
WITHOUT_KEY = {"clarabel", "plotly"}
#: Used where they are there; what cannot do without says so.
OPTIONAL = {"argcomplete", "distributed", "pyarrow"}
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


def imported(folder: Path) -> set[str]:
    """Top names of what a package's modules import, at their head or inside functions."""
    found: set[str] = set()
    for path in (folder / folder.name).rglob("*.py"):
        if FOR_DEVELOPERS & set(path.relative_to(folder).parts):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {folder.name}


@packages
def test_package_names_what_it_imports_and_nothing_else(folder: Path) -> None:
    wanted = {KEYS.get(name, name) for name in imported(folder) - WITHOUT_KEY - OPTIONAL}
    named = {dependency.name for dependency in package(folder).exec_depends}
    assert wanted - named == set(), "missing in package.xml"
    assert named - wanted - BY_NAME == set(), "not imported"


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


def test_ament_flake8_where_it_is_installed() -> None:
    linter = pytest.importorskip("ament_flake8.main")
    places = [str(folder) for folder in (*FOLDERS, ROOT / "tests")]
    code, errors = linter.main_with_errors(argv=["--config", str(ROOT / ".flake8"), *places])
    assert code == 0, "\n".join(errors)


def test_ament_xmllint_where_it_is_installed() -> None:
    linter = pytest.importorskip("ament_xmllint.main")
    assert linter.main(argv=[str(folder / "package.xml") for folder in FOLDERS]) == 0
