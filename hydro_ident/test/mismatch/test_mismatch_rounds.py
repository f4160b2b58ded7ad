"""What is looked for again once everything that was named has been refused."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from hydro_ident.mismatch.answer import confirmation
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.verifying.verify import Verification

STANDS = Verification(1.0e-4, {}, {}, 1.0, True, "")
REFUSED = replace(STANDS, stands=False, reason="too soft")
IDLE = replace(STANDS, stands=False, reason="no longer stands out", idle=True)
CONTACT, SPRING, OFFSET = "external_contact", "counterbalance_spring", "constant_force_offset"


def _finding(name: str, verification: Verification) -> Finding:
    term = SimpleNamespace(effect=SimpleNamespace(name=name), target="lift_cylinder")
    named: Any = SimpleNamespace(term=term, few=1.0)
    return Finding(named, verification, ("lift/force",))


@pytest.fixture
def rounds(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Runs searches whose findings and refusals are given; returns what each was without."""

    def run(*outcomes: tuple[list[Finding], list[Finding]]) -> tuple[Any, list[set[str]]]:
        without, left = list[set[str]](), list(outcomes)

        def searcher(_: Any, base: Any, excluded: set[tuple[str, str]], *others: Any) -> Any:
            without.append({name for name, _ in excluded})
            named = [f.named for outcome in left[:1] for each in outcome for f in each]
            search = SimpleNamespace(named=named)
            return SimpleNamespace(run=lambda: search, contest=None)

        monkeypatch.setattr(confirmation, "Searcher", searcher)
        monkeypatch.setattr(confirmation, "_confirmed", lambda work, search: (None, *left.pop(0)))
        work: Any = SimpleNamespace(scan=None, bank=None, noise_floors=dict, processes=1)
        return confirmation.searched(work, work), without

    return run


def test_what_had_been_fitted_beside_what_was_refused_is_looked_for_again(rounds: Any) -> None:
    """A soft contact took most of a spring; an offset and what was left of it stood beside."""
    stands = _finding(SPRING, STANDS)
    beside = [_finding(CONTACT, REFUSED), _finding(SPRING, IDLE), _finding(OFFSET, IDLE)]
    (_, _, findings, rejected), without = rounds(([], beside), ([stands], []))
    assert without == [set(), {CONTACT}]
    assert findings == [stands]
    # What stands in the end is not told as refused.
    assert [f.named.term.effect.name for f in rejected] == [CONTACT, OFFSET]


def test_it_is_looked_for_once_more_and_not_a_third_time(rounds: Any) -> None:
    first = [_finding(CONTACT, REFUSED), _finding(SPRING, IDLE)]
    again = [_finding(OFFSET, REFUSED), _finding(SPRING, IDLE)]
    _, without = rounds(([], first), ([], again), ([], []))
    assert without == [set(), {CONTACT}, {CONTACT, SPRING, OFFSET}]


def test_what_was_named_before_what_is_refused_had_not_been_fitted_to_what_it_left(
    rounds: Any,
) -> None:
    _, without = rounds(([], [_finding(SPRING, IDLE), _finding(CONTACT, REFUSED)]), ([], []))
    assert without == [set(), {CONTACT, SPRING}]


def test_where_none_is_to_blame_all_are_left_out(rounds: Any) -> None:
    _, without = rounds(([], [_finding(SPRING, IDLE)]), ([], []))
    assert without == [set(), {SPRING}]
