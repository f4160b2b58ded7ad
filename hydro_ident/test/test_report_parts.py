"""Parts of reports by themselves: the table of parameters, words, numbers and colours."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from hydro_ident.identify.recording_summary import JointMotion, RecordingSummary
from hydro_ident.inspecting.inspection import Range
from hydro_ident.parameters.parameters import Parameter
from hydro_ident.report.page import Row, number, paragraph, percent, table, written
from hydro_ident.report.palette import JOINTS, joint_colour
from hydro_ident.report.parameter_section import (
    ParameterRow,
    change_figure,
    identified_row,
    parameter_table,
)
from hydro_ident.report.recording_sections import excitation_section, health_section
from hydro_ident.report.verdict_words import free_run_line
from hydro_ident.rollouts.free_run import FreeRun, JointRollout


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


@pytest.mark.parametrize(
    ("name", "value", "std", "told"),
    [
        ("lift_cylinder.coulomb_friction.velocity_scale", 1e-5, 4e-4, False),
        ("lift_cylinder.coulomb_friction.velocity_scale", 4e-3, 4e-4, True),
        ("lift_cylinder.viscous_friction", 2000.0, 1100.0, False),
        ("lift_cylinder.viscous_friction", 2000.0, 900.0, True),
        ("lift_valve.c_pa", 1e-7, 1e-7, False),
        ("command_delay", 1e-3, 1e-3, False),
        # What may have either sign has no bound at zero.
        ("lift_valve.valve_null_bias.bias", 0.001, 0.01, True),
        ("lift_link.mcz", 2.0, 5.0, True),
    ],
)
def test_what_is_not_told_from_its_bound_is_grey(
    name: str, value: float, std: float, told: bool
) -> None:
    bounds = (0.0, 0.002) if name == "command_delay" else (-np.inf, np.inf)
    row = identified_row(Parameter(name, value, std, "m/s", None, True, bounds=bounds), {})
    assert ("not told from its bound" in row.below) == (not told)
    assert row.off == bool(row.below)


@pytest.mark.parametrize(
    ("value", "std", "datasheet", "grey"),
    [
        (-254.65, 602.0, None, True),
        (-254.65, 602.0, 900.0, True),
        (-254.65, 120.0, None, False),
        # The datasheet's size tells what a small value is small beside.
        (2.0, 4.0, 300.0, False),
    ],
)
def test_what_is_hardly_determined_is_grey(
    value: float, std: float, datasheet: float | None, grey: bool
) -> None:
    row = identified_row(Parameter("lift_link.mcz", value, std, "kg m", datasheet, True), {})
    assert row.off == ("hardly determined" in row.below) == grey


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


def test_numbers_read_as_people_write_them() -> None:
    written = [number(v) for v in (4000.09, 12345.678, 1.767e7, 2.33e-6, 0.0101, None, np.inf)]
    assert written == ["4000", "12350", "1.767e7", "2.33e-6", "0.0101", "–", "–"]


def test_a_share_that_rounds_to_nothing_is_said_in_words() -> None:
    assert [percent(v, 1, "+") for v in (-2e-4, 2e-4, 0.0)] == ["under 0.1 %"] * 2 + ["0.0 %"]
    assert [percent(v) for v in (-0.004, 0.004, -0.006, 0.5)] == ["under 1 %"] * 2 + [
        "-1 %",
        "50 %",
    ]
    assert percent(-0.01, 1, "+") == "-1.0 %"


def test_of_a_joint_rolled_out_by_one_model_alone_nothing_is_compared() -> None:
    none = (None, None, *[np.empty(0)] * 4)
    lone = JointRollout("lift", "rad", 0.004, None, *none)
    both = JointRollout("tilt", "rad", 0.2, 0.1, *none)
    assert free_run_line(FreeRun((lone,), 1, 0, 2.0, (), "")) == []
    [line] = free_run_line(FreeRun((lone, both), 1, 0, 2.0, (), ""))
    assert line.endswith("error: tilt 0.2 → 0.1 rad (11.5 → 5.73°).")


def test_cells_are_text() -> None:
    text = table(("<a>", "b"), [Row(("<i>", "&"), below="<u>", dot="#123456")])
    assert "<i>" not in text
    assert "<u>" not in text
    assert "&lt;i&gt;" in text


@pytest.mark.parametrize(
    ("typed", "read"),
    [
        ("4.9e+06 kg m^2", "4.9e6 kg m²"),
        ("1.5e+02 times, -6.5979e3 N", "150 times, -6597.9 N"),
        ("2e-07 m^3/(s sqrt(Pa))", "2e-7 m³/(s √Pa)"),
        ("1e10, e+05 and x^25", "1e10, e+05 and x^25"),
        ("8.1 +- 0.5 GPa, a+-b", "8.1 ± 0.5 GPa, a+-b"),
    ],
)
def test_texts_read_like_the_numbers_beside_them(typed: str, read: str) -> None:
    assert written(typed) == read
    for value in (4.9e6, 2e-7, 150.0, 1e10):
        assert written(f"{value:.2g}") == number(value, 2)
    assert f"<code>{typed}</code>: {read}" in paragraph(f"`{typed}`: {typed}")


def test_a_stacked_table_has_its_headings_in_its_cells_too() -> None:
    row = ParameterRow("mass", 1.0, (0.9, 1.1), "kg", 2.0, "", False, "")
    [cells] = re.findall(r"<tbody><tr>(.*?)</tr>", parameter_table([row], ()))
    told = dict(re.findall(r'<td data-label="(.*?)">(.*?)</td>', cells))
    assert told["unit"] == "kg"
    assert told["datasheet"] == "2"
    assert told["change"] == "-50.0 %"


def test_a_long_name_may_break_at_its_joints_and_nowhere_else() -> None:
    cells = table(("name", "value"), [("lift_cylinder.c_pa", "a.b"), ("1.5e-3", "x")])
    assert "<td>lift_<wbr>cylinder.<wbr>c_<wbr>pa</td><td>a.b</td>" in cells
    assert "<td>1.5e-3</td>" in cells


EDGE = "m^3/(s sqrt(Pa))"


def test_valve_gains_and_pressures_are_told_as_people_tell_them() -> None:
    rows = [
        ParameterRow("lift_valve.c_pa", 7.7373e-7, None, EDGE, 8.91e-7, "held", False, "lift"),
        ParameterRow("lift_cylinder.bulk_modulus", 5.2e8, None, "Pa", None, "", False, "lift"),
        ParameterRow("tilt_link.iyy", 1469.0, None, "kg m^2", 2075.6, "", False, ""),
    ]
    edge, bulk, inertia = re.findall(r"<tr.*?</tr>", parameter_table(rows, ("lift",)))[1:]
    told = "86.9 l/min at 35 bar per edge (datasheet 100)"
    assert f"<small>{told}; held</small>" in edge
    assert ">m³/(s √Pa)<" in edge
    assert "<small>5200 bar</small>" in bulk
    assert "<small>" not in inertia


def test_ranges_are_told_in_bar_and_degrees_beside_si() -> None:
    ranges = (
        Range("lift position", "rad", 0.4, 1.25, 0.8),
        Range("supply", "Pa gauge", 1.8112e7, 1.8708e7, 1.85371e7),
        Range("lift_valve voltage", "V", -3.0, 5.0, 0.5),
    )
    none = np.zeros((0, 1))
    motion = JointMotion("lift", "rad", 0.4, 1.25, -0.2, 1.5, 0.5, 1.0, 0.7, 7)
    one = RecordingSummary(
        "run", True, 20.0, 100.0, 1, 0, 0, None, (), ranges, (), (motion,), None,
        np.zeros(0), none, none,
    )  # fmt: skip
    text = health_section([one], (), ("lift",)).html()
    angle, pressure, volts = re.findall(r"<tr>.*?</tr>", text.partition("<summary>")[2])[1:]
    assert "<small>22.9 … 71.6, mean 45.8°</small>" in angle
    assert ">rad<" in angle
    assert "<small>181 … 187, mean 185 bar gauge</small>" in pressure
    assert ">Pa gauge<" in pressure
    assert "<small>" not in volts
    moved = excitation_section([one], ("lift",), ()).html()
    # A long name wraps: the table fits a window of 800.
    assert '<td class="text">run</td>' in moved
    assert "<small>22.9 … 71.6°, 28.6°/s</small>" in moved


@pytest.mark.parametrize(
    ("typed", "read"),
    [("0.2 rad = 11.5 deg", "0.2 rad = 11.5°"), ("up to 30 deg C", "up to 30 deg C"),
     ("at 2 deg/s, degC", "at 2°/s, degC")],
)  # fmt: skip
def test_degrees_are_written_with_their_sign(typed: str, read: str) -> None:
    assert written(typed) == read


def test_more_joints_than_colours_are_told_apart_where_they_share_a_figure() -> None:
    joints = [f"joint{k}" for k in range(4 * len(JOINTS))]
    rows = [ParameterRow(f"{j}.x", 1.1, (1.0, 1.2), "N", 1.0, "", False, j) for j in joints]
    drawn = change_figure(rows, joints).partition('application/json">')[2].partition("</script>")
    markers = {trace["name"]: trace["marker"] for trace in json.loads(drawn[0])["data"]}
    looks = {(marker["color"], marker["symbol"]) for marker in markers.values()}
    assert len(looks) == len(markers) == len(joints)
    # A robot of six joints or fewer looks as ever, and each has its colour everywhere.
    assert {markers[joint]["symbol"] for joint in joints[: len(JOINTS)]} == {"circle"}
    assert all(markers[joint]["color"] == joint_colour(joints, joint) for joint in joints)
