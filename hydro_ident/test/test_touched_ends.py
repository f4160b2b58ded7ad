"""A range's end that single samples touch is told by their number and makes nothing unclean."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import recording_of
from hydro_ident.commands.inspect import main
from hydro_ident.identify.recording_summary import RecordingSummary
from hydro_ident.inspecting.health import Finding, _part, find_irregularities
from hydro_ident.report.recording_sections import health_section
from hydro_ident.report.verdict_words import health_line

N = 4000
PRESSURES, VALVES = "/chamber_pressures", "/valve_state"


@pytest.fixture
def ended_bag(write_bag_in, tmp_path, run_columns):
    """A bag of which so many samples of one signal have one value."""

    def write(topic: str, column: int, value: float, count: int):
        columns = run_columns(N)
        columns[topic][1]["effort"][100 : 100 + count, column] = value
        return write_bag_in(tmp_path / str(count), columns, metadata={"robot": "xs031"})

    return write


@pytest.mark.parametrize(
    ("topic", "column", "value", "kind", "where"),
    [
        (VALVES, 0, 10.0, "saturated", "at 10 V"),
        (PRESSURES, 0, 2.6e7, "saturated", "at the end of its range (250 bar)"),
        (PRESSURES, 0, -2e5, "range", "below vacuum"),
    ],
)
def test_single_samples_are_counted_and_harmless_and_many_are_a_share(
    ended_bag, robot, topic, column, value, kind, where
) -> None:
    for count, told in ((1, f"1 of {N} samples"), (3, f"3 of {N} samples"), (400, "10.0% of the")):
        recording = recording_of(read_bag(ended_bag(topic, column, value, count)), robot)
        [found] = [f for f in find_irregularities(recording) if f.kind == kind]
        assert found.text.startswith(told)
        assert where in found.text
        assert found.harmless == (count < 400)


def test_the_least_share_that_counts_is_never_rounded_to_nothing(ended_bag, robot) -> None:
    recording = recording_of(read_bag(ended_bag(VALVES, 0, 10.0, N // 1000)), robot)
    [found] = find_irregularities(recording)
    assert (found.text, found.harmless) == ("0.1% of the time at 10 V", False)


@pytest.mark.parametrize(("count", "harmless"), [(49, True), (50, False), (2950, False)])
def test_a_tenth_of_a_second_is_worth_a_look_however_long_the_recording(
    count: int, harmless: bool
) -> None:
    look = SimpleNamespace(cycles=3_000_000)
    found = _part(look, ("lift_valve", "saturated"), count, "at 10 V", 0.002)  # type: ignore[arg-type]
    assert (found.text, found.harmless) == (f"{count} of 3000000 samples at 10 V", harmless)


def test_inspect_calls_a_bag_healthy_that_touched_an_end(ended_bag, capsys) -> None:
    assert main([str(ended_bag(VALVES, 0, 10.0, 2))]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].endswith(": healthy")
    assert "nothing irregular" in out
    assert f"to know lift_valve: 2 of {N} samples at 10 V" in out
    assert main([str(ended_bag(VALVES, 0, 10.0, 400))]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].endswith(": 1 to look at")
    assert "CHECK   lift_valve: 10.0% of the time at 10 V" in out


def summary(*findings: Finding) -> RecordingSummary:
    none = np.zeros((0, 1))
    return RecordingSummary(
        "run", True, 20.0, 100.0, 1, 0, 0, None, findings, (), (), (), None, np.zeros(0), none,
        none,
    )  # fmt: skip


def test_a_report_is_not_unclean_for_a_touched_end_and_tells_it() -> None:
    touched = Finding("lift_valve", "saturated", "2 of 4000 samples at 10 V", harmless=True)
    stuck = Finding("lift_cylinder/a", "stuck", "unchanged for 3.00 s from 1.00 s on")
    assert health_line([summary(touched)]) == []
    [line] = health_line([summary(touched, stuck)])
    assert "lift_cylinder/a stuck" in line
    assert "lift_valve" not in line
    page = health_section([summary(touched)], (), ("lift",)).html()
    assert "No signal is stuck" in page
    assert "run: lift_valve: 2 of 4000 samples at 10 V" in page
    both = health_section([summary(touched, stuck)], (), ("lift",)).html()
    table, rest = both.partition("Irregular signals")[2].split("</table>", 1)
    assert "lift_cylinder/a" in table.replace("<wbr>", "")
    assert "lift_valve" not in table.replace("<wbr>", "")
    assert "2 of 4000 samples" in rest
