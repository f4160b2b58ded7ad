"""Sabotages of the diagnosis: the list fits the sources, the page the list; misses are told."""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path

import pytest

from hydro_ident.errors import IdentError
from hydro_ident.study.sabotage.listed import SABOTAGES, Sabotage
from hydro_ident.study.sabotage.page import with_table
from hydro_ident.study.sabotage.trial import Court, checked, copied, outcomes

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "hydro_msgs_docs"
BY_NAME = {one.name: one for one in SABOTAGES}
QUICK = BY_NAME["gaps_bridged"]


def test_the_list_fits_the_sources() -> None:
    assert len(BY_NAME) == len(SABOTAGES) >= 14
    checked(ROOT, SABOTAGES)


@pytest.mark.parametrize("one", SABOTAGES, ids=list(BY_NAME))
def test_every_named_test_exists(one: Sabotage) -> None:
    file, _, name = one.test.partition("::")
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_the_page_is_the_list_and_the_committed_run() -> None:
    text = (DOCS / "sabotage.md").read_text(encoding="utf-8")
    assert with_table(text, DOCS / "results") == text


def test_the_committed_run_is_of_the_list_and_caught_all_of_it() -> None:
    run = json.loads((DOCS / "results/sabotage.json").read_text(encoding="utf-8"))
    assert {row["name"]: row["test"] for row in run["sabotages"]} == {
        one.name: one.test for one in SABOTAGES
    }
    assert run["of"] == len(SABOTAGES)
    assert all(row["caught"] and row["before"] == "passed" for row in run["sabotages"])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"text": "no such line"}, "found it 0 times"),
        ({"text": "return"}, "times"),
        ({"replacement": QUICK.text}, "same text"),
        ({"replacement": "linked = ("}, "expected Python"),
        ({"file": "mismatch/no_such.py"}, "source file"),
        ({"test": "hydro_ident/test/test_no_such.py::test"}, "expected its test"),
    ],
)
def test_a_sabotage_that_does_not_fit_stops_everything(changes: dict, says: str) -> None:
    with pytest.raises(IdentError, match=says):
        next(outcomes(ROOT, [QUICK, replace(QUICK, name="misfit", **changes)]))


def test_the_sources_stay_as_they_are_and_the_copy_is_what_runs() -> None:
    path = ROOT / "hydro_ident/hydro_ident" / QUICK.file
    before = path.read_bytes()
    with copied(ROOT, QUICK) as copy:
        changed = (copy / "hydro_ident" / QUICK.file).read_text(encoding="utf-8")
        assert QUICK.replacement in changed
        assert QUICK.text not in changed
    assert path.read_bytes() == before
    assert not copy.exists()


def test_other_sources_than_the_copys_end_the_run(tmp_path: Path) -> None:
    with Court(ROOT) as court, pytest.raises(IdentError, match="imported from"):
        court.tested(tmp_path, [QUICK.test], [QUICK.module])


def test_what_is_noticed_is_caught_and_what_is_not_is_missed() -> None:
    """A real fault, one without consequence, and one that breaks the test itself."""
    harmless = replace(QUICK, name="harmless", replacement=f"{QUICK.text}  # as it was")
    broken = replace(QUICK, name="broken", replacement="raise ValueError('broken')")
    found = list(outcomes(ROOT, [QUICK, harmless, broken]))
    assert [one.caught for one in found] == [True, False, False]
    assert {one.before.end for one in found} == {"passed"}
    ends = [one.after.end for one in found if one.after is not None]
    assert ends == ["assertion", "passed", "error"]
    assert "passes all the same" in found[1].text
    assert "without judging" in found[2].text
