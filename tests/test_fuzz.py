"""Every loader over broken files: those of the corpus, and edits of them by hypothesis."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hydro_ident.study.fuzz.campaign import case, prepare, time_limit
from hydro_ident.study.fuzz.corpus import files, named, seeds
from hydro_ident.study.fuzz.edits import Edit, edited
from hydro_ident.study.fuzz.targets import TARGETS, outcome
from hydro_ident.study.kills import MOMENTS

ROOT = Path(__file__).parents[1]
CORPUS = ROOT / "tests/corpus"
RESULTS = ROOT / "hydro_msgs_docs/results"
KEPT = [(target.name, path.name) for target in TARGETS for path in files(target, CORPUS)]
INTEGERS = st.integers(0, (1 << 31) - 1)
EDITS = st.lists(st.tuples(INTEGERS, INTEGERS, INTEGERS), min_size=1, max_size=4)


def _tried(path: Path, name: str, data: bytes) -> str:
    path.write_bytes(data)
    with time_limit():
        return outcome(named(name), path)


@pytest.mark.parametrize(("name", "file"), KEPT)
def test_files_of_the_corpus_are_read_or_refused_in_a_line(
    tmp_path: Path, name: str, file: str
) -> None:
    target = named(name)
    path = prepare(target, tmp_path, CORPUS)
    said = _tried(path, name, (CORPUS / name / file).read_bytes())
    # Those that were found by fuzzing are named so, and are no good.
    assert bool(said) == file.startswith("refused_"), said


@pytest.mark.parametrize("name", [target.name for target in TARGETS])
def test_what_nobody_wrote_is_read_or_refused_in_a_line(tmp_path: Path, name: str) -> None:
    own = seeds(named(name), CORPUS)
    path = prepare(named(name), tmp_path, CORPUS)

    @settings(
        max_examples=40,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(INTEGERS, EDITS)
    def each(which: int, edits: Sequence[Edit]) -> None:
        _tried(path, name, edited(own[which % len(own)], edits, own[-1]))

    each()


def test_a_run_of_the_campaign_can_be_repeated() -> None:
    for target in TARGETS:
        own = seeds(target, CORPUS)
        assert case(target, own, 3) == case(target, own, 3)
        assert case(target, own, 3) != case(target, own, 4)


def test_the_committed_campaign_found_nothing_and_the_page_says_what_it_tried() -> None:
    found = json.loads((RESULTS / "fuzz.json").read_text(encoding="utf-8"))
    tallies = found["targets"]
    assert set(tallies) == {target.name for target in TARGETS}
    tried = sum(t["read"] + t["refused"] + len(t["findings"]) for t in tallies.values())
    assert [t["findings"] for t in tallies.values() if t["findings"]] == []
    page = " ".join((ROOT / "hydro_msgs_docs/bags.md").read_text(encoding="utf-8").split())
    slowest = max(t["slowest_s"] for t in tallies.values())
    said = (
        f"run of {found['date']}: {tried} files, {found['seconds'] / 60:.0f} minutes, 0 findings,"
        f" slowest file {slowest:.2f} s of processor time, {found['peak_mb']} MB at most"
    )
    assert said in page


def test_the_committed_kills_keep_the_promise() -> None:
    found = json.loads((RESULTS / "recorder_kills.json").read_text(encoding="utf-8"))
    kills = found["kills"]
    assert len(kills) >= 20
    assert all(kill["lost_s"] <= 0.3 + 3.0 * kill["late_s"] for kill in kills)
    assert sum(kill["missing"] for kill in kills) == 0
    # Anywhere, around a new file and while closing, and some of these before the bag was closed.
    at = [kill["moment"] for kill in kills]
    assert min(at.count(moment) for moment in MOMENTS) >= 10
    assert max(kill["files"] for kill in kills if kill["moment"] == "roll-over") > 2
    assert {kill["closed"] for kill in kills if kill["moment"] == "closing"} == {False, True}
    lost = sorted(kill["lost_s"] for kill in kills)
    page = " ".join((ROOT / "hydro_msgs_docs/bags.md").read_text(encoding="utf-8").split())
    shown = re.search(r"(\d+) recorders killed .*? lost ([\d.]+) s at worst", page)
    assert shown is not None
    assert (int(shown[1]), float(shown[2])) == (len(kills), round(lost[-1], 2))
