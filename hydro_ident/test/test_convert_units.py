"""Units that were mistaken in a mapping are warned of, of every quantity that has a scale."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.errors import BagError
from hydro_ident.logs.convert import convert
from hydro_ident.logs.file import read_log
from hydro_ident.logs.map import read_map

EXAMPLES = Path(__file__).resolve().parents[2] / "hydro_msgs_docs" / "log_examples"


def warnings(folder: Path, *changes: tuple[str, str]) -> tuple[str, ...]:
    """Of the LabVIEW example with another mapping."""
    text = (EXAMPLES / "labview.map.yaml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "map.yaml").write_text(text, encoding="utf-8")
    log = read_log(EXAMPLES / "labview.lvm")
    return convert(log, read_map(folder / "map.yaml"), folder / "bag", {}).warnings


def test_nothing_is_warned_of_where_units_are_right(tmp_path: Path) -> None:
    assert warnings(tmp_path) == ()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("bar,", "Pa,", "bar: is the unit another one, or was the pump off?"),
        ("bar,", "MPa,", "bar: is the unit another one?"),
        ("bar,", "psi,", "bar: is the unit another one, or was the pump off?"),
        ("unit: V}", "unit: mV}", "V: is the unit another one, or did none open?"),
        ("unit: V}", "unit: V, scale: 1000}", "V: is the unit another one?"),
        ("unit: deg}", "unit: rad}", "or the unit it is in"),
        ("unit: s,", "unit: ms,", "another one, seconds read as milliseconds?"),
    ],
)
def test_a_mistaken_unit_is_warned_of(old: str, new: str, said: str, tmp_path: Path) -> None:
    found = warnings(tmp_path, (old, new))
    assert found
    assert all(text.endswith(said) for text in found)
    assert all("expected" in text and "found" in text for text in found)


def test_without_a_robot_nothing_is_known_of_units(tmp_path: Path) -> None:
    assert warnings(tmp_path, ("robot: xs031\n", ""), ("bar,", "Pa,")) == ()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("unit: deg}", "unit: mm}", "joints, lift: 'unit' of a joint that turns should be one of"
         " rad, deg, mrad, gon, found 'mm': the way of its cylinder goes under strokes"),
        ("valve_commands:", "efforts: {tilt: {signal: x, unit: kN}}\nvalve_commands:",
         "efforts, tilt: 'unit' of a joint that turns should be one of N m, kN m, found 'kN': the"
         " force of its cylinder is no torque of the joint"),
    ],
)  # fmt: skip
def test_a_unit_that_the_robots_joint_cannot_have_is_refused(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    """A cylinder's stroke had become rad, its force N m, number for number."""
    with pytest.raises(BagError) as refusal:
        warnings(tmp_path, (old, new))
    assert said in str(refusal.value)


def test_a_slide_is_told_its_units(tmp_path: Path) -> None:
    lines = ["robot: emps", "time: {rate_hz: 1000}", "joints: {carriage: {signal: qm, unit: cm}}"]
    (tmp_path / "map.yaml").write_text("\n".join(lines), encoding="utf-8")
    assert read_map(tmp_path / "map.yaml").sections["joints"]["carriage"].factor == 0.01
    wrong = lines[-1].replace("cm", "deg")
    (tmp_path / "map.yaml").write_text("\n".join([*lines[:2], wrong]), encoding="utf-8")
    with pytest.raises(BagError, match="should be one of m, mm, cm, found 'deg'"):
        read_map(tmp_path / "map.yaml")


@pytest.mark.parametrize(
    ("section", "unit", "reading", "si"),
    [
        ("oil_temperature", "K", 300.0, 26.85),
        ("oil_temperature", "degF", 104.0, 40.0),
        ("joints: {carriage", "gon", 200.0, math.pi),
        ("pressures: {supply", "atm", 2.0, 202650.0),
        ("pressures: {supply", "mbar", 1013.25, 101325.0),
        ("pressures: {supply", "kgf/cm2", 10.0, 980665.0),
    ],
)
def test_what_units_are_in_si(
    section: str, unit: str, reading: float, si: float, tmp_path: Path
) -> None:
    """Kelvin and Fahrenheit have zeros of their own."""
    entry = f"{section}: {{signal: x, unit: {unit}, scale: 1.0"
    entry += ", reference: absolute" if "pressures" in section else ""
    entry += "}}" if ":" in section else "}"
    held = "strokes: {c: {constant: 1}}"
    (tmp_path / "map.yaml").write_text(f"time: {{rate_hz: 100}}\n{held}\n{entry}\n")
    mapping = read_map(tmp_path / "map.yaml")
    signal = mapping.oil_temperature or next(
        one for s, block in mapping.sections.items() if s != "strokes" for one in block.values()
    )
    assert signal.values(np.array([reading]))[0] == pytest.approx(si, abs=1e-9)
