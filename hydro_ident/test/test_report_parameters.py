"""Parameters of a report: as many digits as are known, and whose value a grey row shows."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from hydro_ident.mismatch.answer.outcome import MATCHES, Diagnosis
from hydro_ident.report.diagnosis_report import _parameters
from hydro_ident.report.model_parameters import model_rows
from hydro_ident.report.parameter_section import ParameterRow, as_known, parameter_table
from hydro_model.robot import BaseParameter
from hydro_model.robot_files import load_robot

GIVEN = load_robot("xs031")
SHEET = dict(zip(GIVEN.parameter_names, GIVEN.parameter_vector.tolist(), strict=True))


@pytest.mark.parametrize(
    ("value", "half", "said"),
    [
        (6.7567, 8.2, ("6.8", "-1.4", "15")),
        (1019.04, 7.96, ("1019", "1011.1", "1027")),
        (8.8864e-7, 5.6e-9, ("8.886e-7", "8.83e-7", "8.942e-7")),
        (3.9063e-5, 2.4e-3, ("3.9e-5", "-0.0024", "0.0024")),
        (1234.567, 1e-3, ("1234.6", "1234.6", "1234.6")),
    ],
)
def test_digits_end_where_the_interval_begins(
    value: float, half: float, said: tuple[str, ...]
) -> None:
    interval = value - half, value + half
    assert tuple(as_known(v, interval) for v in (value, *interval)) == said
    assert as_known(1234.567, None) == "1234.6"


def test_what_people_tell_has_no_more_digits_than_is_known() -> None:
    bulk = ParameterRow("bulk", 1.1798e9, (1.0728e9, 1.2868e9), "Pa", 1.2e9, "", False, "lift")
    edge = ParameterRow(
        "c_pa", 8.8864e-7, (8.83e-7, 8.943e-7), "m^3/(s sqrt(Pa))", 8.91e-7, "", False, "lift"
    )
    body = parameter_table([bulk, edge], ("lift",))
    assert "<small>11800 bar (datasheet 12000)</small>" in body
    assert "<small>99.7 l/min at 35 bar per edge (datasheet 100)</small>" in body


def diagnosis(name: str, value: float, std: float) -> Diagnosis:
    """One base parameter of a model that was found."""
    base = (BaseParameter(name, {name: 1.0}, value),)
    robot = replace(GIVEN, base_parameters=base, base_covariance=np.array([[std**2]]))
    return Diagnosis(MATCHES, GIVEN, robot)


NAME = "lift_cylinder_barrel.mcx"


@pytest.mark.parametrize(
    ("value", "std", "told"),
    [
        (1.11 * SHEET[NAME], 4.2, "hardly determined: its interval is wider than the value itself;"
         " the value found is in the model"),
        (SHEET[NAME], 0.0, "these recordings do not determine it: the given value stays"),
        (1.11 * SHEET[NAME], 0.0, "these recordings do not determine it: the value shown came with"
         " the others'"),
    ],
)  # fmt: skip
def test_a_grey_row_shows_the_value_of_the_model_and_says_whose_it_is(
    value: float, std: float, told: str
) -> None:
    found = diagnosis(NAME, value, std)
    row = model_rows(found, {})[0]
    assert row.off
    assert row.value == value
    assert row.below.endswith(told)
    # The lead does not say otherwise of all of them.
    section = _parameters(found)
    assert "as model.yaml has them" in section.lead
    assert "given value stays" not in section.lead
    body = unescape(section.body).replace("<wbr>", "")
    [first] = [r for r in re.findall(r"<tr.*?</tr>", body) if f">{NAME}<" in r]
    assert 'class="off"' in first
    assert as_known(value, row.interval) in first
