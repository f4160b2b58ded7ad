"""Every loader over broken files: those of the corpus, and edits of them by hypothesis."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hydro_ident.study.fuzz.__main__ import _run as fuzz
from hydro_ident.study.fuzz.campaign import case, prepare, time_limit
from hydro_ident.study.fuzz.corpus import files, named, seeds
from hydro_ident.study.fuzz.edits import Edit, edited
from hydro_ident.study.fuzz.sources import changed, digests
from hydro_ident.study.fuzz.targets import TARGETS, outcome
from hydro_ident.study.kills import MOMENTS
from hydro_ident.study.kills import digests as killed

ROOT = Path(__file__).parents[1]
CORPUS = ROOT / "tests/corpus"
RESULTS = ROOT / "hydro_msgs_docs/results"
KEPT = [(target.name, path.name) for target in TARGETS for path in files(target, CORPUS)]
INTEGERS = st.integers(0, (1 << 31) - 1)
EDITS = st.lists(st.tuples(INTEGERS, INTEGERS, INTEGERS), min_size=1, max_size=4)


def _tried(path: Path, name: str, data: bytes) -> str:
    path.unlink(missing_ok=True)  # one that is emptied goes to the disk each time
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


def test_the_committed_campaign_says_which_sources_it_is_of() -> None:
    """Who changes a loader runs `scripts/fuzz.sh` again, or lets it say what has changed since."""
    found = json.loads((RESULTS / "fuzz.json").read_text(encoding="utf-8"))
    then = found["sources"]
    assert {"hydro_ident/hydro_ident/logs/text.py", *map(str, _loaders())} <= set(then)
    assert found["changed_since"] == changed(then, ROOT), (
        "run: scripts/fuzz.sh --minutes 0 --json hydro_msgs_docs/results/fuzz.json"
    )
    page = " ".join((ROOT / "hydro_msgs_docs/bags.md").read_text(encoding="utf-8").split())
    names = ", ".join(f"`{Path(path).name}`" for path in found["changed_since"])
    since = f" Changed since that run: {names}." if names else ""
    assert f"MB at most.{since} It reads" in page


def _loaders() -> set[Path]:
    """Modules that the campaign's own ones import from, as far as they read files."""
    text = (ROOT / "hydro_ident/hydro_ident/study/fuzz/targets.py").read_text(encoding="utf-8")
    tops = {"hydro_model": Path("ros2_ws/src/hydro_model")}
    names = re.findall(r"from (hydro_\w+)\.([\w.]+) import", text)
    paths = {tops.get(t, Path(t)) / t / f"{m.replace('.', '/')}.py" for t, m in names}
    return {path for path in paths if path.stem not in ("errors", "shipped_mapping")}


def test_what_has_changed_since_a_run_is_said_anew(tmp_path: Path) -> None:
    of = digests(ROOT)
    assert changed(of, ROOT) == []
    edited_one = {**of, sorted(of)[0]: "0", "gone.py": "1"}
    assert changed(edited_one, ROOT) == sorted([sorted(of)[0], "gone.py"])
    file = tmp_path / "fuzz.json"
    file.write_text(json.dumps({"sources": edited_one, "changed_since": []}), encoding="utf-8")
    assert fuzz(["--corpus", str(CORPUS), "--minutes", "0", "--json", str(file)]) == 0
    assert json.loads(file.read_text())["changed_since"] == changed(edited_one, ROOT)


def test_the_committed_kills_keep_the_promise() -> None:
    found = json.loads((RESULTS / "recorder_kills.json").read_text(encoding="utf-8"))
    kills = found["kills"]
    # Who changes what records, or reads what is left, runs them again.
    assert found["sources"] == killed(ROOT)
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
