"""What rows are made of is written beside them, and the page says what has changed since."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hydro_ident.bench import made, names, page
from hydro_ident.bench.command import _write, main
from hydro_ident.bench.job import Row
from hydro_ident.bench.limits import BASE
from hydro_ident.errors import IdentError

ROW = Row(BASE, "100 us", 5e-5, 1e-4, 2.0, 1.0, 3)
LAW = "hydro_control/hydro_control/law/law.py"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A repository with a few sources, its page and a run."""
    for path in (
        *(LAW, "hydro_ident/hydro_ident/study/peak.py", "hydro_ident/hydro_ident/bench/page.py"),
        *(
            "hydro_ident/hydro_ident/study/oracle.py",
            "hydro_ident/hydro_ident/recordings/sources.py",
        ),
    ):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("x = 1\n")
    results = tmp_path / "docs" / "results"
    results.mkdir(parents=True)
    places = [
        f"<!-- {name}: begin -->\n<!-- {name}: end -->\n"
        for name in (*page.RESULTS.values(), "soaks")
    ]
    (tmp_path / "docs" / page.PAGE).write_text("\n".join(places))
    _write(results / "bench.json", [ROW], made.made(tmp_path))
    return tmp_path


def published(root: Path) -> str:
    assert main(["--publish", str(root / "docs"), "--root", str(root)]) == 0
    return (root / "docs" / page.PAGE).read_text()


def test_a_run_says_which_sources_it_measured(root: Path) -> None:
    run = json.loads((root / "docs/results/bench_made.json").read_text())
    used = {
        LAW,
        "hydro_ident/hydro_ident/study/peak.py",
        "hydro_ident/hydro_ident/recordings/sources.py",
    }
    assert set(run["sources"]) == used
    assert run["cores"] >= 1
    assert set(run["threads"]) == set(made.THREADS)
    assert f"Run of {run['date']}, commit {run['commit']}, {run['cores']} cores" in published(root)


def test_the_page_says_what_changed_since(root: Path) -> None:
    assert "changed since" not in published(root)
    (root / LAW).write_text("x = 2\n")
    (root / "hydro_ident/hydro_ident/bench/page.py").write_text("x = 2\n")
    text = published(root)
    assert f"Of the 3 sources measured, changed since: `{LAW}`." in text
    assert page.with_tables(text, root / "docs" / "results") == text


def test_what_other_rows_were_made_of_is_refused(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = root / "docs/results/bench.json"
    file.write_text(file.read_text().replace('"rounds": 3', '"rounds": 5'))
    assert main(["--publish", str(root / "docs"), "--root", str(root)]) == 2
    assert "found that of other rows" in capsys.readouterr().err


def test_rows_of_jobs_that_are_gone_are_refused(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = root / "docs/results/bench.json"
    before = (root / "docs" / page.PAGE).read_text()
    file.write_text(json.dumps([Row("a job of old", "a peer", 1.0, 2.0, 2.0, 1.0).as_json()]))
    assert main(["--publish", str(root / "docs"), "--root", str(root)]) == 2
    assert "expected jobs of the benchmark, found a job of old" in capsys.readouterr().err
    assert (root / "docs" / page.PAGE).read_text() == before


def test_jobs_are_known_by_their_whole_names() -> None:
    names.refuse_unknown(
        [BASE, "player, a bag of 1 to 10 minutes: exponent of processor time"], ""
    )
    with pytest.raises(IdentError, match="here: expected jobs of the benchmark"):
        names.refuse_unknown([f"{BASE}9"], "here")


def test_a_folder_without_sources_is_not_the_repository(tmp_path: Path) -> None:
    with pytest.raises(IdentError, match="found no sources there"):
        made.digests(tmp_path)
