"""YAML is read alike by libyaml and by PyYAML alone, and refused alike."""

from __future__ import annotations

import importlib.util
from importlib.resources import files
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro_model.description import safe_yaml

HOSTILE = {
    "aliases": "a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9, 0]\n"
    + "".join(f"{n}: &{n} [{', '.join([f'*{chr(ord(n) - 1)}'] * 10)}]\n" for n in "bcdef"),
    "itself": "a: &a [1, *a]",
    "twice": "a: 1\nb: 2\na: 3",
    "object": "a: !!python/object/apply:os.system ['true']",
    "digits": f"a: {'1' * 500}",
    "nested": "[" * 5000 + "]" * 5000,
    "many": f"[{'1, ' * safe_yaml.MAX_NODES}1]",
    "tab": "a:\n\t- 1",
    "open": "a: [1, 2 }\nb: 3",
    "control": "a: \x01",
    "two": "a: 1\n---\nb: 2",
    "no-anchor": "a: *b",
}


@pytest.fixture(scope="module")
def slow() -> ModuleType:
    """The module as it is where PyYAML was built without libyaml."""
    spec = importlib.util.spec_from_file_location("without_libyaml", safe_yaml.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yaml, "__with_libyaml__", False)
        spec.loader.exec_module(module)
    assert module._Events is module._PythonEvents
    return module


def test_libyaml_reads_where_it_is_there() -> None:
    assert yaml.__with_libyaml__ == (safe_yaml._Events is not safe_yaml._PythonEvents)


def test_shipped_files_say_the_same(slow: ModuleType) -> None:
    shipped = sorted(Path(str(files("hydro_model"))).rglob("*.yaml"))
    assert len(shipped) >= 4
    for path in shipped:
        text = path.read_text(encoding="utf-8")
        assert safe_yaml.parse(text) == slow.parse(text)


@settings(max_examples=40, deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
def test_whatever_is_written_comes_back_by_both(slow: ModuleType, data: object) -> None:
    text = yaml.safe_dump(data)
    assert safe_yaml.parse(text) == slow.parse(text) == data


@pytest.mark.parametrize("case", HOSTILE)
def test_what_one_refuses_the_other_refuses_by_the_same_line(slow: ModuleType, case: str) -> None:
    with pytest.raises(safe_yaml.UnusableYamlError) as fast:
        safe_yaml.parse(HOSTILE[case])
    with pytest.raises(slow.UnusableYamlError) as other:
        slow.parse(HOSTILE[case])
    said, expected = str(fast.value), str(other.value)
    assert "\n" not in said
    # In their own words, of the same place (at a file's end libyaml names the line behind it).
    assert said.split(":")[0] == expected.split(":")[0]
