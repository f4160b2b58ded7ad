"""Reports: order, honest plots, units, escaped names, one file that fetches nothing."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identification import Identification, identify
from hydro_ident.report.channel_rows import channel_rows
from hydro_ident.report.correlation import autocorrelation, cross_correlation
from hydro_ident.report.figure import BINS, Figure, line, one_after_another, path, thinned
from hydro_ident.report.identification_report import report_html
from hydro_ident.report.law_section import binned
from hydro_ident.report.page import Row, number, paragraph, table, written
from hydro_ident.report.palette import JOINTS, joint_colour
from hydro_ident.report.parameter_section import ParameterRow, parameter_table
from hydro_model.kinematics import tip_position
from hydro_model.robot_files import load_robot

ROOT = Path(__file__).resolve().parents[2]
SECTIONS = [
    "verdict",
    "health",
    "excitation",
    "parameters",
    "predictions",
    "laws",
    "correlation",
    "free_run",
    "control",
    "provenance",
]
LARGEST_BYTES = 8_000_000
ORIGIN = {
    "command": "identify 'a & b' --robot <robot>",
    "version": "0.1.0",
    "robot": "<robot>",
    "bags": [{"name": "run<b>1</b>&.mcap", "sha256": "0" * 64}],
    "validation": [],
}


class Reader(HTMLParser):
    """Collects sections, addresses and figures, and checks that tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sections: list[str] = []
        self.addresses: list[str] = []
        self.figures: list[dict[str, Any]] = []
        self.text = ""
        self.style = ""
        self._json = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "srcset", "action")]
        if tag == "section":
            self.sections.append(given.get("id") or "")
        self._json = given.get("type") == "application/json"
        if tag not in ("meta", "wbr"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._json:
            self.figures.append(json.loads(data))
            self._json = False
        elif self.open and self.open[-1] == "style":
            self.style += data
        elif self.open and self.open[-1] != "script":
            self.text += data


def read(report: str) -> Reader:
    reader = Reader()
    reader.feed(report)
    assert reader.open == []
    return reader


@pytest.fixture(scope="module")
def found(crane_run: Any) -> Identification:
    robot, count = load_robot("xs031"), len(crane_run.q)
    rail = np.ones(count)
    recording = Recording(
        path=Path("run"), robot=robot, stamp_ns=10**18 + np.arange(count) * 2_000_000,
        period_s=0.002, q=crane_run.q, stroke=None, effort=None, p_a=crane_run.p_a,
        p_b=crane_run.p_b, supply=robot.supply_pressure_pa * rail,
        tank=robot.tank_pressure_pa * rail, valve_v=crane_run.voltage,
        valve_source="/valve_state", command_v=crane_run.voltage, spool=None,
        latched=np.zeros(count, dtype=bool), q_ref=None, qd_ref=None, force_ref=None,
        tip_ref=np.asarray(tip_position(robot, crane_run.q)) + np.array([0.003, 0.0, 0.0]),
        temperature_stamp_ns=None, temperature_c=None, losses=(), gaps=(), duplicates={},
        notes=(), metadata={},
    )  # fmt: skip
    return identify(robot, [recording])


@pytest.fixture(scope="module")
def report(found: Identification) -> str:
    return report_html(found, ORIGIN)


def values(trace: dict[str, Any], axis: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(trace[axis]["bdata"]), dtype="<f4")


def test_sections_stand_in_the_order_of_the_questions(report: str) -> None:
    assert read(report).sections == SECTIONS


def test_a_report_is_one_small_file_that_fetches_nothing(report: str) -> None:
    reader = read(report)
    assert len(report.encode()) < LARGEST_BYTES
    assert all(address.startswith("#") for address in reader.addresses)
    assert {address[1:] for address in reader.addresses} == set(SECTIONS) - {"verdict"}
    assert "http" not in reader.text
    assert "url(" not in reader.style
    assert "@import" not in reader.style
    assert "default-src 'none'" in report


def test_every_axis_of_every_figure_has_a_title_with_a_unit(report: str) -> None:
    figures = read(report).figures
    assert len(figures) > 20
    for figure in figures:
        # Plotly's own validators: a misspelt or impossible property raises. Names that begin with
        # two dashes are colours of the style sheet, which the page's script looks up.
        go.Figure(json.loads(re.sub(r'"--[a-z]+"', '"#000000"', json.dumps(figure))))
        axes = [k for k in figure["layout"] if re.match(r"[xy]axis", k)]
        assert {t["yaxis"] for t in figure["data"]} <= {k.replace("axis", "") for k in axes}
        for axis in axes:
            title = figure["layout"][axis]["title"]["text"]
            assert re.search(r" in \S+|\(no unit\)|\(name\)", title), title


def test_names_of_files_cannot_break_the_page(report: str) -> None:
    assert "run&lt;b&gt;1&lt;/b&gt;&amp;.mcap" in report
    assert "run<b>" not in report
    assert "<robot>" not in report
    figure = Figure("</script><b>", "t in s", ("y in N",), [])
    figure.traces.append({"name": "</script><!--", "yaxis": "y"})
    inner = figure.html().split('<script type="application/json">')[1]
    assert inner.count("<") == inner.count("</script>") + inner.count("</figure>") == 2


def test_the_numbers_are_those_of_the_result(found: Identification, report: str) -> None:
    text = read(report).text
    for p in found.parameters:
        assert number(p.value, 5) in text
        assert p.name in text
    for channel in found.channels:
        for key in ("rmse_before", "rmse_after", "noise_floor"):
            assert number(float(channel.summary()[key])) in text


def test_recordings_are_told_by_their_own_figures(found: Identification, report: str) -> None:
    [run] = found.recordings
    assert run.training
    assert run.rate_hz == pytest.approx(500.0)
    assert (run.gaps, run.missing, run.thinned) == (0, 0, 1)
    low, high = run.position.min(axis=0), run.position.max(axis=0)
    for k, joint in enumerate(run.motion):
        assert (joint.low, joint.high) == pytest.approx((low[k], high[k]))
        assert 0.0 < joint.speed < np.abs(run.velocity[:, k]).max()
        assert joint.reversals >= 4
    assert run.tracking is not None
    assert run.tracking.rmse_mm == pytest.approx(3.0)
    assert result_dict_tracks(found)
    text = read(report).text
    assert number(run.tracking.rmse_mm) in text
    assert "No signal is stuck" in text or "Irregular signals" in text


def result_dict_tracks(found: Identification) -> bool:
    """Whether the result's entries hold the same figures and no samples."""
    entries = [one.as_dict() for one in found.recordings]
    return json.loads(json.dumps(entries)) == entries and "position" not in entries[0]


def test_rows_of_the_fit_are_shown_beside_rows_that_took_no_part(found: Identification) -> None:
    assert [c.name for c in found.fitted] == [c.name for c in found.channels]
    for trained, held in zip(found.fitted, found.channels, strict=True):
        assert not set(trained.time_s.tolist()) & set(held.time_s.tolist())
        assert trained.speed is not None
        assert np.isfinite(trained.speed).all()


def test_what_is_not_determined_is_grey_and_says_why() -> None:
    rows = [
        ParameterRow("known", 1.0, (0.9, 1.1), "N", 2.0, "", False, "lift"),
        ParameterRow("unknown", 1.0, None, "N", None, "never <moved>", True, ""),
    ]
    known, unknown = re.findall(r"<tr.*?</tr>", parameter_table(rows, ("lift",)))[1:]
    assert "off" not in known
    assert "-50.0 %" in known
    assert 'class="off"' in unknown
    assert "never &lt;moved&gt;" in unknown


def test_a_joint_has_one_colour_everywhere(found: Identification, report: str) -> None:
    joints = found.given.joint_names
    figures = read(report).figures
    for joint, colour in ((j, joint_colour(joints, j)) for j in joints):
        assert colour in JOINTS
        others = set(JOINTS) - {colour}
        own = [f for f in re.findall(r"<figcaption>(.*?)<", report) if f.startswith(joint)]
        assert own
        for title, figure in zip(re.findall(r"<figcaption>(.*?)<", report), figures, strict=True):
            if title.startswith((f"{joint}:", f"{joint},")):
                assert not any(other in json.dumps(figure) for other in others)


def test_colours_stand_out_on_light_and_dark_paper() -> None:
    for colour in JOINTS[:5]:
        for paper in ("#ffffff", "#12161b"):
            light, dark = sorted((_luminance(colour), _luminance(paper)), reverse=True)
            assert (light + 0.05) / (dark + 0.05) > 2.0


def _luminance(colour: str) -> float:
    """Relative luminance (WCAG 2.1)."""
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    linear = [v / 12.92 if v <= 0.03928 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_a_peak_of_one_sample_survives_thinning() -> None:
    x, y = np.linspace(0.0, 10.0, 100_000), np.zeros(100_000)
    y[61_234] = 1.0
    xs, ys = thinned(x, y)
    assert xs.size <= 2 * BINS + 2
    assert ys.max() == 1.0
    assert xs[np.argmax(ys)] == x[61_234]


def test_lines_break_where_time_jumps_and_recordings_follow_each_other() -> None:
    x = np.concatenate([np.arange(100) * 0.1, 50.0 + np.arange(100) * 0.1])
    assert np.isnan(thinned(x, np.sin(x))[0]).sum() == 1
    again = one_after_another(np.concatenate([x, x]))
    assert np.all(np.diff(again) > 0.0)
    assert np.array_equal(again[:200], x)


def test_a_constant_or_single_sample_or_nothing_still_plots() -> None:
    for count in (5, 1, 0):
        trace = line("y", (np.arange(float(count)), np.full(count, 3.0)), "#000000")
        assert values(trace, "y").size == count


def test_a_path_keeps_its_order_and_its_extremes() -> None:
    t = np.linspace(0.0, 60.0, 50_000)
    x, y = np.sin(t), np.cos(3.0 * t)
    trace = path("p", (x, y), "#000000")
    assert values(trace, "x").size < 6 * BINS
    assert values(trace, "x").max() == pytest.approx(x.max(), abs=1e-6)
    assert values(trace, "y").min() == pytest.approx(y.min(), abs=1e-6)


def test_white_noise_stays_in_its_band_and_a_tied_residual_leaves_it() -> None:
    rng = np.random.default_rng(1)
    time_s = np.arange(4000) * 0.02
    white = rng.normal(size=4000)
    slow = np.convolve(white, np.ones(25) / 25.0, mode="same")
    calm, tied = autocorrelation(time_s, white), autocorrelation(time_s, slow)
    assert calm is not None
    assert tied is not None
    assert calm.value[0] == pytest.approx(1.0)
    assert calm.outside < 0.15
    assert tied.outside > 0.2
    # Fifty rows of a moving mean over twenty-five share half of them at half its length.
    assert tied.value[12] == pytest.approx(0.5, abs=0.1)


def test_gaps_do_not_make_a_correlation() -> None:
    rng = np.random.default_rng(2)
    time_s = np.arange(6000) * 0.02
    kept = (time_s % 20.0) > 4.0
    found = autocorrelation(time_s[kept], rng.normal(size=6000)[kept])
    assert found is not None
    assert found.outside < 0.15


def test_a_residual_that_follows_the_motion_shows_at_its_lag() -> None:
    rng = np.random.default_rng(3)
    time_s = np.arange(4000) * 0.02
    motion = np.convolve(rng.normal(size=4000), np.ones(5), mode="same")
    residual = np.roll(motion, 10) + rng.normal(size=4000)
    found = cross_correlation(time_s, residual, motion)
    assert found is not None
    assert found.lag_s[np.argmax(found.value)] == pytest.approx(0.2)
    calm = cross_correlation(time_s, rng.normal(size=4000), motion)
    assert calm is not None
    assert calm.outside < 0.2


def test_too_few_rows_have_no_correlogram() -> None:
    assert autocorrelation(np.arange(10.0), np.arange(10.0)) is None
    assert autocorrelation(np.arange(100.0), np.zeros(100)) is None


def test_reversals_lie_where_the_motion_turns() -> None:
    t = np.arange(2000) * 0.02
    speed = np.sin(2.0 * np.pi * t / 8.0)
    flat = np.zeros_like(t)
    rows = channel_rows(
        ("lift/force", "N"), (t, flat, flat, flat), (speed, "joint velocity", "rad/s"), {}
    )
    turns = rows.reversals()
    assert len(turns) == 3
    for one in turns:
        inside = speed[one]
        assert inside.min() < 0.0 < inside.max()
        assert abs(np.mean(inside)) < 0.1
    assert rows.joint == "lift"


def test_a_law_is_drawn_through_the_medians_of_its_rows() -> None:
    x = np.linspace(-1.0, 1.0, 2001)
    at, middle, low, high = binned(x, np.sign(x))
    assert np.all(np.diff(at) > 0.0)
    assert middle[0] == -1.0
    assert middle[-1] == 1.0
    assert np.all(low <= middle)
    assert np.all(middle <= high)


def test_numbers_read_as_people_write_them() -> None:
    written = [number(v) for v in (4000.09, 12345.678, 1.767e7, 2.33e-6, 0.0101, None, np.inf)]
    assert written == ["4000", "12350", "1.767e7", "2.33e-6", "0.0101", "–", "–"]


def test_cells_are_text() -> None:
    text = table(("<a>", "b"), [Row(("<i>", "&"), below="<u>", dot="#123456")])
    assert "<i>" not in text
    assert "<u>" not in text
    assert "&lt;i&gt;" in text


@pytest.fixture
def browser_check() -> Callable[[Path], dict[str, Any]]:
    script = ROOT / "scripts" / "check_report.py"
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    if not any(shutil.which(name) for name in names):
        pytest.skip("no Chromium here: the report is not opened in a browser")

    def check(report: Path) -> dict[str, Any]:
        done = subprocess.run(
            [sys.executable, script, report], capture_output=True, text=True, timeout=900
        )
        assert done.stdout, done.stderr
        answer: dict[str, Any] = json.loads(done.stdout)
        return answer

    return check


def test_a_browser_opens_it_without_errors_at_every_width(
    report: str, tmp_path: Path, browser_check: Callable[[Path], dict[str, Any]]
) -> None:
    file = tmp_path / "report <1>.html"
    file.write_text(report, encoding="utf-8")
    seen = browser_check(file)
    assert [view["found"] for view in seen["views"]] == [[]] * len(seen["views"])
    looked = [(v["width"], v["scheme"]) for v in seen["views"] if "width" in v]
    assert looked == [(w, s) for w in (390, 820, 1400) for s in ("light", "dark")]
    papers = {v["scheme"]: v["paper"] for v in seen["views"] if "width" in v}
    assert papers["light"] != papers["dark"]


@pytest.mark.parametrize(
    ("typed", "read"),
    [
        ("4.9e+05 kg m^2", "4.9e5 kg m²"),
        ("2e-07 m^3/(s sqrt(Pa))", "2e-7 m³/(s √Pa)"),
        ("1e10, e+05 and x^25", "1e10, e+05 and x^25"),
    ],
)
def test_texts_read_like_the_numbers_beside_them(typed: str, read: str) -> None:
    assert written(typed) == read
    assert f"<code>{typed}</code>: {read}" in paragraph(f"`{typed}`: {typed}")


def test_a_long_name_may_break_at_its_joints_and_nowhere_else() -> None:
    cells = table(("name", "value"), [("lift_cylinder.c_pa", "a.b"), ("1.5e-3", "x")])
    assert "<td>lift_<wbr>cylinder.<wbr>c_<wbr>pa</td><td>a.b</td>" in cells
    assert "<td>1.5e-3</td>" in cells
