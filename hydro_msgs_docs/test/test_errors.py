"""All that the package raises on purpose has one root."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest

import hydro_msgs_docs
from hydro_msgs_docs.cdr import CdrError
from hydro_msgs_docs.errors import ContractError

#: Errors by the module that defines them; found without importing what needs ROS.
DEFINED = [
    (path.stem, node.name)
    for path in sorted(Path(hydro_msgs_docs.__file__).parent.glob("*.py"))
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    if isinstance(node, ast.ClassDef) and node.name.endswith("Error")
]


@pytest.mark.parametrize(("module", "name"), DEFINED)
def test_an_error_of_the_package_has_its_root(module: str, name: str) -> None:
    error = getattr(import_module(f"hydro_msgs_docs.{module}"), name)
    assert issubclass(error, ContractError)


def test_bytes_that_are_no_message_are_values_that_cannot_be_read_as_well() -> None:
    assert issubclass(CdrError, ValueError)
    assert len(DEFINED) >= 6
