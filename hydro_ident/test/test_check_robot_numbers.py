"""`check_robot`: single numbers in another unit are told, and the unit that fits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_ident.identify.identified_robot import has_definite_mass
from hydro_ident.robots.robot_check import ERROR, WARNING, Remark, check_robot
from hydro_model.multibody.joint_ranges import limits
from hydro_model.multibody.rigid_body import mass_matrix
from hydro_model.robot import STANDARD_PARAMETERS, Robot
from hydro_model.robot_files import load_robot, shipped_robots

LIFT, PRESSURE = ("cylinders", 0), ("sensors", "pressure")
#: Of one number each: where it stands, what it is set to, and what is said.
ODD_NUMBERS: list[tuple[tuple[str | int, ...], float, str, str, str]] = [
    (("fluid", "atmospheric_pressure_pa"), 1.01325, ERROR, "fluid", "1.013 bar are 1.013e+05 Pa"),
    (("fluid", "atmospheric_pressure_pa"), 101.325, ERROR, "fluid", "101.3 kPa are"),
    (("fluid", "bulk_modulus_pa"), 1200.0, ERROR, "fluid", "1200 MPa are 1.2e+09 Pa"),
    (("fluid", "bulk_modulus_pa"), 1.2, ERROR, "fluid", "1.2 GPa are 1.2e+09 Pa"),
    ((*LIFT, "bulk_modulus_pa"), 1.2e13, ERROR, "lift_cylinder", "expected 1e+07 to 5e+09"),
    ((*PRESSURE, "range_pa"), 250.0, ERROR, "sensors", "250 bar are 2.5e+07 Pa"),
    ((*PRESSURE, "range_pa"), 10e6, ERROR, "sensors", "below the supply of 1.9e+07 Pa"),
    (("supply", "tank_pressure_pa"), 10.0, WARNING, "supply", "10 bar are 1e+06 Pa"),
    (("valves", 0, "rated_voltage_v"), 1e4, WARNING, "lift_valve", "1e+04 mV are 10 V"),
    (("sensors", "encoder", "counts_per_rev"), 20, WARNING, "sensors", "20 bits are 1048576"),
    (("sensors", "rate_hz"), 0.5, WARNING, "sensors", "0.5 kHz are 500 Hz"),
    (("sensors", "rate_hz"), 0.002, WARNING, "sensors", "a period in s? That of 500 Hz"),
    ((*LIFT, "child_pin_angle_rad"), -10.6, WARNING, "lift_cylinder", "Those are -0.185 rad"),
]
#: In the URDF: what is replaced, by what, and what is said of which.
ODD_LINKS = [
    ('effort="40000" velocity="1.0"', 'effort="40000" velocity="57.3"', "lift", "are 1 rad/s"),
    ('<mass value="641.42"/>', '<mass value="0.64142"/>', "tilt_link", "mass 0.64142 kg"),
]


@pytest.fixture
def spoilt(tmp_path: Path) -> Callable[..., list[Remark]]:
    """What is said of the reference crane with other numbers, or another URDF, and not before."""
    source = shipped_robots()["xs031"]

    def check(
        *changes: tuple[tuple[str | int, ...], float], urdf: tuple[str, str] = ("", "")
    ) -> list[Remark]:
        data: Any = yaml.safe_load(source.read_text(encoding="utf-8"))
        for keys, value in changes:
            at = data
            for key in keys[:-1]:
                at = at[key]
            at[keys[-1]] = value
        file = tmp_path / source.name
        file.write_text(yaml.safe_dump(data), encoding="utf-8")
        text = source.with_name("xs031.urdf").read_text(encoding="utf-8")
        assert urdf[0] in text
        (tmp_path / "xs031.urdf").write_text(text.replace(*urdf), encoding="utf-8")
        before = check_robot(load_robot("xs031")).remarks
        found = check_robot(load_robot(file, check_strokes=False)).remarks
        return [remark for remark in found if remark not in before]

    return check


def told(remarks: list[Remark], level: str, about: str) -> list[str]:
    return [r.text for r in remarks if (r.level, r.about) == (level, about)]


@pytest.mark.parametrize(("keys", "value", "level", "about", "said"), ODD_NUMBERS)
def test_one_number_in_another_unit_is_told(
    keys: tuple[str | int, ...],
    value: float,
    level: str,
    about: str,
    said: str,
    spoilt: Callable[..., list[Remark]],
) -> None:
    """All of these had passed without a word."""
    assert any(said in text for text in told(spoilt((keys, value)), level, about))


@pytest.mark.parametrize(("old", "new", "about", "said"), ODD_LINKS)
def test_speeds_and_masses_in_another_unit_are_worth_a_look(
    old: str, new: str, about: str, said: str, spoilt: Callable[..., list[Remark]]
) -> None:
    assert any(said in text for text in told(spoilt(urdf=(old, new)), WARNING, about))


def test_a_range_below_a_supply_in_another_unit_says_nothing_more(
    spoilt: Callable[..., list[Remark]],
) -> None:
    remarks = spoilt((("supply", "pressure_pa"), 18e11))
    assert told(remarks, ERROR, "supply")
    assert not told(remarks, ERROR, "sensors")


def test_masses_that_fail_at_an_end_of_the_ranges_are_found_by_all_who_look() -> None:
    """An identified arm had a definite mass in 64 poses drawn at random, and none at a corner."""
    robot = load_robot("xs031")

    def lighter(share: float) -> Robot:
        inertia = robot.link_inertia.copy()
        inertia[0, STANDARD_PARAMETERS.index("iyy")] *= share
        inertia[0, STANDARD_PARAMETERS.index("mass")] *= share
        return replace(robot, link_inertia=inertia)

    low, high = -100.0, 1.0
    assert has_definite_mass(lighter(high))
    assert not has_definite_mass(lighter(low))
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if has_definite_mass(lighter(middle)) else (middle, high)
    limit = lighter(low)
    ends = limits(limit).T
    draws = ends[0] + np.random.default_rng(0).uniform(size=(64, 2)) * (ends[1] - ends[0])
    assert np.linalg.eigvalsh(mass_matrix(limit, draws)).min() > 0.0
    remarks = list(check_robot(limit).remarks)
    assert any("not positive definite" in text for text in told(remarks, ERROR, "xs031"))
