"""Units that people use: beside SI in texts, right in size, and nowhere in files."""

from __future__ import annotations

import pytest

from hydro_ident.everyday_units import beside, told


@pytest.mark.parametrize(
    ("values", "unit", "text"),
    [
        ((8.053e6, 1.75e7), "Pa gauge", "80.5 to 175 bar gauge"),
        ((5.2058e8,), "Pa", "5206 bar"),
        ((0.3971, -1.804), "rad", "22.8 to -103 deg"),
        ((1.3e-5,), "m^3/s", "0.78 l/min"),
        # 100 l/min at 35 bar per edge is c sqrt(35e5) with c = 100 / 60000 / sqrt(35e5).
        ((100.0 / 6e4 / 35e5**0.5,), "m^3/(s sqrt(Pa))", "100 l/min at 35 bar per edge"),
        ((1.0,), "N", ""),
        ((float("nan"), 1.0), "Pa", ""),
    ],
)
def test_numbers_as_people_tell_them(values: tuple[float, ...], unit: str, text: str) -> None:
    assert beside(values, unit) == text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "at a pressure a of 3e+06 to 8.5e+06 Pa",
            "at a pressure a of 3e+06 to 8.5e+06 Pa = 30 to 85 bar",
        ),
        ("repeats every 0.204 rad)", "repeats every 0.204 rad = 11.7 deg)"),
        ("(5.41e-06 m^3/s rms, time", "(5.41e-06 m^3/s rms = 0.325 l/min, time"),
        ("at 0.5 rad/s", "at 0.5 rad/s = 28.6 deg/s"),
        # Of units that go on, nothing is known.
        ("2 m^3/s^2, 3 rad m, 1e-9 Pa s/m and 4 N", None),
        ("7e-07 m^3/(s sqrt(Pa))", None),
    ],
)
def test_texts_have_them_behind_their_numbers(text: str, said: str | None) -> None:
    assert told(text) == (said or text)
