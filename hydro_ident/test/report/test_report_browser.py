"""What is seen of reports in a browser, and what `check_report.py` says of one that fails."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.report.figure import Figure, line

ROOT = Path(__file__).resolve().parents[3]
#: What makes the report.
needs = pytest.mark.needs("clarabel", "plotly")


def _looked_at(folder: Path, report: str, browser: str) -> subprocess.CompletedProcess[str]:
    """What `check_report.py` says with a script for its browser."""
    fake = folder / "chromium"
    fake.write_text(f"#!/bin/sh\n{browser}\n", encoding="utf-8")
    fake.chmod(0o755)
    file = folder / "report.html"
    file.write_text(report, encoding="utf-8")
    return subprocess.run(
        [sys.executable, ROOT / "scripts" / "check_report.py", file, "--wait", "1"],
        env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip


@needs
@pytest.mark.parametrize(
    ("browser", "said"),
    [("exec sleep 600", "says nothing for 1 s"), ("exit 3", "the browser is gone|Broken pipe")],
)
def test_a_browser_that_fails_is_no_finding(
    report: str, tmp_path: Path, browser: str, said: str
) -> None:
    done = _looked_at(tmp_path, report, browser)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(rf"\S+: could not be looked at: .*({said}).*\n", done.stderr)


@needs
def test_a_browser_that_a_script_started_ends_with_it(report: str, tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    done = _looked_at(tmp_path, report, f"sleep 600 &\necho $! >'{pid}'\nwait")
    assert done.returncode == 2
    state = Path(f"/proc/{int(pid.read_text())}/stat")
    # It may stand there dead until somebody asks for it.
    assert not state.exists() or state.read_text().rsplit(")", 1)[1].split()[0] == "Z"


@pytest.mark.thorough
@needs
def test_a_browser_opens_it_without_errors_at_every_width(
    report: str, tmp_path: Path, browser_check: Callable[..., dict[str, Any]]
) -> None:
    file = tmp_path / "report <1>.html"
    file.write_text(report, encoding="utf-8")
    seen = browser_check(file)
    assert [view["found"] for view in seen["views"]] == [[]] * len(seen["views"])
    looked = [(v["width"], v["scheme"]) for v in seen["views"] if "width" in v]
    assert looked == [(w, s) for w in (390, 820, 1400) for s in ("light", "dark")]
    papers = {v["scheme"]: v["paper"] for v in seen["views"] if "width" in v}
    assert papers["light"] != papers["dark"]
    # On paper several figures stand on a page.
    assert 2 * seen["views"][-1]["pages"] < seen["views"][0]["figures"]
    # A tablet shows tables whole, a telephone those that are wide as far as it can.
    scrolling = {v["width"]: v["scrolling"] for v in seen["views"] if "width" in v}
    assert [scrolling[820], scrolling[1400]] == [[], []]
    assert "channel" in scrolling[390]
    # A finger cannot drag in a plot: it would move the page.
    hints = {v["width"]: v["hint"] for v in seen["views"] if "width" in v}
    assert [("drag" in hints[w], "tap" in hints[w]) for w in (390, 820, 1400)] == [
        (False, True), (True, False), (True, False),
    ]  # fmt: skip


def test_a_title_that_its_figure_cuts_off_is_found(
    tmp_path: Path, browser_check: Callable[[Path], dict[str, Any]]
) -> None:
    text = '<text x="{}" y="40">force in N</text>'
    file = tmp_path / "figure.html"
    file.write_text(
        '<meta name="viewport" content="width=device-width"><div class="canvas" aria-label="law">'
        '<svg class="main-svg" width="200" height="50" style="overflow:hidden;display:block">'
        f'{text.format(150)}</svg></div><div class="canvas" aria-label="whole" style="width:9em">'
        f'<svg class="main-svg" width="100" height="50">{text.format(5)}</svg></div>'
        '<style>.canvas{width:200px}</style>',
        encoding="utf-8",
    )  # fmt: skip
    for view in browser_check(file)["views"][:-1]:
        (said,) = view["found"]
        assert re.fullmatch(r"cut off: 'force in N' of 'law' by \d+ px", said)


def test_numbers_of_axes_that_lie_on_one_another_are_found(
    tmp_path: Path, browser_check: Callable[..., dict[str, Any]]
) -> None:
    text = '<text x="10" y="{}">{}</text>'
    tick, other = (f'<g class="{name}">{{}}</g>' for name in ("ytick", "y2tick"))
    near = tick.format(text.format(20, "5")) + other.format(text.format(26, "−1"))
    apart = tick.format(text.format(20, "5")) + other.format(text.format(46, "−1"))
    file = tmp_path / "figure.html"
    file.write_text(
        '<meta name="viewport" content="width=device-width">'
        + "".join(
            f'<div class="canvas" aria-label="{name}">'
            f'<svg class="main-svg" width="200" height="60" font-size="12">{inside}</svg></div>'
            for name, inside in (("near", near), ("apart", apart))
        )
        + "<style>.canvas{width:200px}</style>",
        encoding="utf-8",
    )
    for view in browser_check(file, 390)["views"]:
        assert view["found"] == ["one on the other: '5' on '−1' of 'near'"]


@pytest.mark.needs("plotly")
def test_panels_keep_their_numbers_and_titles_apart_on_paper_too(
    tmp_path: Path, browser_check: Callable[..., dict[str, Any]]
) -> None:
    from hydro_ident.report.page import Section, Verdict, page

    t = np.linspace(-1.0, 1.0, 200)
    forces = line("measured", (t, 43e3 + 17.5e3 * t), "#000000")
    left = line("after", (t, -5e3 + 10.4e3 * t), "#000000", panel=1)
    shown = Figure("lift", "time in s", ("force in N", "error in N"), [forces, left]).html()
    body = shown + f'<div class="pair">{shown}{shown}</div>'
    file = tmp_path / "report.html"
    sections = [Section("one", "One", "lead", body)]
    file.write_text(page("t", Verdict("good", "h", "w", ()), sections), encoding="utf-8")
    seen = browser_check(file, 390, 1400)["views"]
    assert [view["found"] for view in seen] == [[]] * len(seen)


def test_what_fails_when_the_scheme_changes_is_found_in_that_view(
    tmp_path: Path, browser_check: Callable[..., dict[str, Any]]
) -> None:
    file = tmp_path / "report.html"
    file.write_text(
        "<!DOCTYPE html><title>One</title><script>"
        'matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {'
        "for (const end = performance.now() + 200; performance.now() < end;);"
        'throw Error("not drawn"); });</script>',
        encoding="utf-8",
    )
    light, dark, _ = browser_check(file, 390)["views"]
    assert light["found"] == []
    assert len(dark["found"]) == 1
    assert "not drawn" in dark["found"][0]
