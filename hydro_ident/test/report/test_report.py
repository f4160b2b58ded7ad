"""Reports: order, honest plots, units, escaped names, one file that fetches nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.gaps import find_gaps
from hydro_ident.commands.identify import summary_text
from hydro_ident.identify.identification import Identification
from hydro_ident.identify.recording_summary import recording_summaries
from hydro_ident.identify.survey import survey_source
from hydro_ident.identify.verdict import NOT_ENOUGH
from hydro_ident.recordings.sources import sources_of
from hydro_ident.report.correlation import Correlogram
from hydro_ident.report.figure import Figure
from hydro_ident.report.identification_verdict import identification_verdict
from hydro_ident.report.page import number
from hydro_ident.report.palette import JOINTS, joint_colour
from hydro_ident.report.parameter_section import (
    ParameterRow,
    as_known,
    identified_row,
    parameter_table,
)
from hydro_ident.report.recording_sections import health_section
from hydro_ident.report.verdict_words import DRIVE

pytestmark = pytest.mark.needs("clarabel", "plotly")

LARGEST_BYTES = 8_000_000

Page = Callable[[Identification], str]
Read = Callable[[str], Any]


def test_sections_stand_in_the_order_of_the_questions(report: str, read: Read) -> None:
    reader = read(report)
    assert reader.sections == reader.ORDER


def test_a_report_is_one_small_file_that_fetches_nothing(report: str, read: Read) -> None:
    reader = read(report)
    assert len(report.encode()) < LARGEST_BYTES
    assert all(address.startswith("#") for address in reader.addresses)
    assert {address[1:] for address in reader.addresses} == set(reader.ORDER) - {"verdict"}
    assert "http" not in reader.text
    assert "url(" not in reader.style
    assert "@import" not in reader.style
    assert "default-src 'none'" in report


def test_every_axis_of_every_figure_has_a_title_with_a_unit(
    report: str, figures_of: Callable[[str], list[dict[str, Any]]]
) -> None:
    assert len(figures_of(report)) > 20


def test_names_of_files_cannot_break_the_page(report: str) -> None:
    assert "run&lt;b&gt;1&lt;/b&gt;&amp;.mcap" in report
    assert "run<b>" not in report
    assert "<robot>" not in report
    figure = Figure("</script><b>", "t in s", ("y in N",), [])
    figure.traces.append({"name": "</script><!--", "yaxis": "y"})
    inner = figure.html().split('<script type="application/json">')[1]
    assert inner.count("<") == inner.count("</script>") + inner.count("</figure>") == 2


def test_the_numbers_are_those_of_the_result(
    found: Identification, report: str, read: Read
) -> None:
    text = read(report).text
    for p in found.parameters:
        assert as_known(p.value, p.ci95) in text
        assert p.name in text
    for channel in found.channels:
        for key in ("rmse_before", "rmse_after", "noise_floor"):
            assert number(float(channel.summary()[key])) in text


def test_recordings_are_told_by_their_own_figures(
    found: Identification, report: str, read: Read
) -> None:
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


def test_data_health_tells_the_longest_gap_and_when(crane_run: Any) -> None:
    whole = crane_run.recording()
    kept = np.r_[0:500, 520:3000, 3003 : len(whole)]
    stamps = whole.stamp_ns[kept]
    per_cycle = ("q", "p_a", "p_b", "supply", "tank", "valve_v", "command_v", "latched")
    broken = {name: getattr(whole, name)[kept] for name in per_cycle}
    gaps = find_gaps(stamps, whole.period_s)
    recording = replace(whole, stamp_ns=stamps, gaps=gaps, **broken)
    surveys = [survey_source(s, whole.robot) for s in sources_of([recording, whole])]
    summaries = recording_summaries(surveys, 2)
    gap = summaries[0].longest_gap
    assert gap is not None
    assert (gap.after_s, gap.length_s, gap.missing) == pytest.approx((0.998, 0.042, 20))
    assert summaries[1].longest_gap is None
    assert summaries[0].as_dict()["longest_gap"]["missing"] == 20
    section = health_section(summaries, (), whole.robot.joint_names).html()
    [first, second] = re.findall(r"<tr><td>run</td>(.*?)</tr>", section)[:2]
    assert "<td>23</td><td>0.042 s at 0.998 s</td>" in first
    assert "<td>0</td><td>–</td>" in second


def test_rows_of_the_fit_are_shown_beside_rows_that_took_no_part(found: Identification) -> None:
    assert [c.name for c in found.fitted] == [c.name for c in found.channels]
    for trained, held in zip(found.fitted, found.channels, strict=True):
        assert not set(trained.time_s.tolist()) & set(held.time_s.tolist())
        assert trained.speed is not None
        assert np.isfinite(trained.speed).all()


def test_the_strip_counts_what_stands_in_black(found: Identification, page_of: Page) -> None:
    wide = [p for p in found.parameters if p.identifiable and not p.held][:2]
    loose = {p.name: replace(p, std=10.0 * max(abs(p.value), abs(p.datasheet or 0))) for p in wide}
    changed = tuple(loose.get(p.name, p) for p in found.parameters)
    text = page_of(replace(found, parameters=changed))
    count, total = map(int, re.findall(r"(\d+) of (\d+) parameters are determined", text)[0])
    rows = [identified_row(p, {}) for p in changed]
    assert (count, total) == (sum(not row.off for row in rows), len(rows))
    assert "greyed, too: " in text


def test_values_of_an_earlier_model_are_not_called_the_datasheets(
    found: Identification, report: str, page_of: Page, read: Read
) -> None:
    """A model.yaml brings deviations with it, a datasheet none."""
    assert "the earlier model" not in report
    assert found.robot is not None
    assert found.robot.standard_deviations
    html = page_of(replace(found, given=found.robot))
    text = read(html).text
    assert 'data-label="earlier model"' in html
    assert "parameters differ from the earlier model by more than" in text
    assert "Change from the earlier model, with 95 % intervals" in text
    assert "datasheet" not in text


def test_signs_of_parameters_are_explained_where_they_stand(report: str, read: Read) -> None:
    text = read(report).text
    assert "mcx, mcy, mcz: first moments, the mass times the coordinates of its centre" in text
    assert "c_pa, c_at, c_pb, c_bt: gains of a valve's edges" in text
    assert "flow at full opening and a pressure drop of 35 bar over the edge" in text


def test_the_strip_tells_pressures_in_bar(
    found: Identification, page_of: Page, read: Read
) -> None:
    bulk = next(p for p in found.parameters if p.name.endswith("bulk_modulus"))
    changed = replace(bulk, value=6.0e8, std=1e6, datasheet=1.2e9)
    rest = [replace(p, datasheet=None) for p in found.parameters if p is not bulk]
    text = read(page_of(replace(found, parameters=(changed, *rest)))).text
    assert "6e8 instead of 1.2e9 Pa (6000 instead of 12000 bar, -50 %)" in text


def test_the_terminal_tells_valves_in_litres_per_minute_beside_si(found: Identification) -> None:
    lines = summary_text(found).splitlines()
    edge = next(p for p in found.parameters if p.name == "lift_valve.c_pa")
    (line,) = [one for one in lines if one.startswith("  lift_valve.c_pa ")]
    assert f"{edge.value:.5g}" in line
    flow = 6e4 * 35e5**0.5 * edge.value
    assert f" = {flow:.3g} l/min at 35 bar per edge" in line
    (line,) = [one for one in lines if one.startswith("  lift_cylinder.bulk_modulus ")]
    assert re.search(r" Pa = \d+ bar  \(given ", line)
    (line,) = [one for one in lines if one.startswith("  lift free run ")]
    assert re.search(r" rad \([\d.e-]+ -> [\d.e-]+ deg\)$", line)
    (line,) = [one for one in lines if one.startswith("  lift/flow_a ")]
    assert re.search(r" m\^3/s \([\d.e-]+ -> [\d.e-]+ l/min\), fit ", line)


def test_a_joint_has_one_colour_everywhere(found: Identification, report: str, read: Read) -> None:
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


def test_the_strip_says_no_width_of_zero(found: Identification, page_of: Page) -> None:
    thin = tuple(replace(p, std=1e-9 * abs(p.value)) for p in found.parameters)
    text = page_of(replace(found, parameters=thin))
    assert "the middle one to less than ±0.1 % (95 %)." in text
    assert "-0.0 %" not in text
    assert "±0.0 %" not in text


def test_what_is_not_enough_is_no_improvement(found: Identification, page_of: Page) -> None:
    assert found.channels
    html = page_of(replace(found, verdict=NOT_ENOUGH, robot=None))
    strip = html.partition('id="verdict"')[2].partition("</section>")[0]
    for said in ("error changes", "Simulated for", "determined, the middle", "→"):
        assert said not in strip
    # What has to be mended stands where one looks for what to do, and no designed run mends it.
    zero = "the encoder's zero is off: calibrate"
    html = page_of(replace(found, verdict=NOT_ENOUGH, robot=None, problems=(zero,)))
    strip = html.partition('id="verdict"')[2].partition("</section>")[0]
    do_next = strip.partition("What to do next")[2]
    assert "The encoder&#x27;s zero is off: calibrate." in do_next
    assert "excite" not in do_next


def test_a_model_is_to_be_driven_with_the_machines_own_gains_and_slowly_first(
    found: Identification,
) -> None:
    assert "gains that this machine was driven with" in DRIVE
    assert "slowly first" in DRIVE
    assert DRIVE in what_to_do(found)


def test_a_model_that_no_machine_can_have_is_not_to_be_driven(
    found: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert found.inertial is not None
    said = (
        "run was recorded as robot 'mh26', not xs031: every parameter is that of another machine"
    )
    assert DRIVE not in what_to_do(replace(found, problems=(said,)))
    assert DRIVE not in what_to_do(replace(found, robot=None))
    module = "hydro_ident.report.identification_verdict"
    with monkeypatch.context() as patch:
        patch.setattr(f"{module}.impossible", lambda _result: "no bodies have them")
        assert DRIVE not in what_to_do(found)
    for channel in (found.inertial.model.channels[0], "lift/flow_a"):
        with monkeypatch.context() as patch:
            patch.setattr(f"{module}.rejected_channels", lambda *_fits, c=channel: {c})
            assert (DRIVE in what_to_do(found)) == (channel == "lift/flow_a")


def what_to_do(found: Identification) -> tuple[str, ...]:
    return dict(identification_verdict(found, []).cards)["What to do next"]


def test_an_identification_that_nothing_was_scored_on_is_not_called_good(
    found: Identification, page_of: Page
) -> None:
    html = page_of(replace(found, channels=()))
    assert "verdict good" in page_of(found)
    assert "verdict good" not in html
    strip = html.partition('id="verdict"')[2].partition("</section>")[0]
    assert "Nothing was scored on rows that took no part in the fit" in strip


def test_a_number_does_not_break_behind_its_exponents_minus(report: str, read: Read) -> None:
    row = ParameterRow("c_pa", 6.8143e-7, (-6e-7, 7.12e-7), "1", 7e-7, "", False, "")
    [cells] = re.findall(r"<tbody><tr>(.*?)</tr>", parameter_table([row], ()))
    told = dict(re.findall(r'<td data-label="(.*?)">(.*?)</td>', cells))
    whole = [f'<span class="n">{n}</span>' for n in ("6.8e-7", "-6e-7", "7.1e-7")]
    assert told["value"] == whole[0]
    assert told["95 % interval"] == f"{whole[1]} … {whole[2]}"
    style = read(report).style
    assert re.search(r"\.n\{white-space:nowrap\}", style)
    # Names alone may break anywhere on a narrow screen.
    anywhere = re.findall(r"([^{}]*)\{[^{}]*overflow-wrap:anywhere", style)
    assert [one.strip() for one in anywhere] == ["code", ".stack td:first-child"]


@pytest.mark.parametrize("rounding", [0.0, 1e-16, -1e-16])
def test_that_a_residual_is_tied_to_itself_counts_as_no_lag(rounding: float) -> None:
    """Whatever its rounding: of twenty lags it would make five of a hundred more."""
    lags = 0.05 * np.arange(21)
    value, band = np.full(21, 0.01), np.full(21, 0.08)
    value[0], band[0] = 1.0 - rounding, 0.0
    assert Correlogram(lags, value, band).outside == 0.0
    value[3] = 0.2
    assert Correlogram(lags, value, band).outside == 1.0 / 20.0
