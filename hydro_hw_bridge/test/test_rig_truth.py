"""Truth files and random machines: strict, physical, and unlike the datasheet."""

from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.pose import joints_for_tip
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import LinkTruth, Truth, check_physical, links_of
from hydro_hw_bridge.rig.truth_files import load_truth, shipped_truths
from hydro_model.errors import HydroError
from hydro_model.robot import FloatArray, Robot


def _link_numbers(link: LinkTruth) -> np.ndarray[Any, Any]:
    inertia = link.inertia_com_kg_m2
    return np.array([link.mass_kg, *link.com_m[[0, 2]], *np.diag(inertia)])


def test_links_of_the_datasheet_are_those_of_the_urdf(robot: Robot) -> None:
    lift, tilt = links_of(robot)
    np.testing.assert_allclose(_link_numbers(lift), [128.51, 0.7404, 0.0368, 2.0, 25.35, 25.0])
    assert tilt.mass_kg == 641.42


def test_realistic_shares_no_number_with_the_datasheet(robot: Robot) -> None:
    truth = load_truth("realistic", robot)
    for real, paper in zip(truth.links, links_of(robot), strict=True):
        check_physical(real, "realistic")
        ratio = _link_numbers(real) / _link_numbers(paper)
        assert (np.abs(ratio - 1.0) > 0.0999).all()
        assert (np.abs(ratio - 1.0) < 0.301).all()
    ratios = []
    for valve, sheet in zip(truth.valves, robot.valves, strict=True):
        ratios += [getattr(valve, n) / getattr(sheet, n) for n in ("c_pa", "c_at", "c_pb", "c_bt")]
        assert valve.deadband == 0.01
        assert abs(valve.null_bias) == 0.005
        assert valve.natural_frequency_hz == 100.0
    assert len(set(ratios)) == 8
    assert max(abs(r - 1.0) for r in ratios) <= 0.2
    assert truth.fluid.bulk_modulus_pa != robot.cylinders[0].bulk_modulus_pa
    assert truth.supply.pressure_pa != robot.supply_pressure_pa
    for real_cylinder, cylinder in zip(truth.cylinders, robot.cylinders, strict=True):
        assert real_cylinder.coulomb_friction_n == 4000.0
        assert 25e3 < real_cylinder.viscous_friction < 45e3
        for name in ("barrel", "rod"):
            part, sheet_part = getattr(real_cylinder, name), getattr(cylinder, name)
            for field in fields(part):
                ratio = getattr(part, field.name) / getattr(sheet_part, field.name)
                assert 0.09 < abs(ratio - 1.0) < 0.301
    assert truth.command_delay_cycles == 1


def test_realistic_file_gives_every_number_it_has(robot: Robot) -> None:
    truth = load_truth("realistic", robot)
    data = yaml.safe_load(shipped_truths()["realistic"].read_text(encoding="utf-8"))
    assert truth.supply.droop == data["supply"]["droop"] == 2.5e8
    assert truth.cylinders[1].internal_leakage == data["cylinders"][1]["internal_leakage"]
    assert truth.sensors.pressure_noise_pa == 4000.0


@pytest.mark.parametrize("seed", range(30))
def test_random_machines_are_bodies_unlike_the_datasheet(robot: Robot, seed: int) -> None:
    truth = random_truth(robot, seed)
    for real, paper in zip(truth.links, links_of(robot), strict=True):
        assert np.linalg.eigvalsh(real.second_moment())[0] > 0.0
        assert 0.0999 < abs(real.mass_kg / paper.mass_kg - 1.0) < 0.3001
        moments = [np.linalg.eigvalsh(link.second_moment()) for link in (real, paper)]
        assert (np.abs(moments[0] / moments[1] - 1.0) > 0.05).any()
    for valve, sheet in zip(truth.valves, robot.valves, strict=True):
        assert abs(valve.c_pa / sheet.c_pa - 1.0) <= 0.2
    again = random_truth(robot, seed)
    np.testing.assert_array_equal(again.links[0].com_m, truth.links[0].com_m)
    assert again.valves == truth.valves
    assert random_truth(robot, seed + 1).valves != truth.valves


def test_ideal_is_the_datasheet(robot: Robot) -> None:
    truth = Truth.ideal(robot)
    assert truth.valves[0].c_pa == robot.valves[0].c_pa
    assert truth.fluid.bulk_modulus_pa == robot.cylinders[0].bulk_modulus_pa
    assert truth.command_delay_cycles == 0
    assert not truth.sensors.quantised
    assert load_truth("ideal", robot).sensors.quantised


def test_model_of_base_parameters_is_no_truth(robot: Robot) -> None:
    rows = np.zeros_like(robot.link_inertia)
    rows[:, 1] = 100.0
    with pytest.raises(BridgeError, match="no physical body"):
        Truth.ideal(replace(robot, link_inertia=rows))


def _changed(path: Path, change: Any) -> str:
    data = yaml.safe_load(shipped_truths()["realistic"].read_text(encoding="utf-8"))
    change(data)
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("schema"), "'schema' is missing"),
        (lambda d: d.update(schema="x/2"), "expected schema hydro_hw_bridge/truth/1"),
        (lambda d: d.update(robot="other"), "expected a truth of robot xs031, found one of other"),
        (lambda d: d.update(colour="red"), "key 'colour' is unknown"),
        (lambda d: d.update(command_delay_cycles=0.5), "whole number"),
        (lambda d: d["links"].pop(), "'tilt_link' is missing"),
        (lambda d: d["links"][0].update(name="boom"), "'boom' is unknown"),
        (lambda d: d["valves"].append(d["valves"][0]), "'lift_valve' is twice"),
        (lambda d: d["links"][0].update(mass_kg=-1.0), "no physical body"),
        (
            lambda d: d["links"][0].update(inertia_com_kg_m2=[1, 0, 0, 9, 0, 1]),
            "no physical body",
        ),
        (lambda d: d["valves"][0].pop("c_pa"), "'c_pa' is missing"),
        (lambda d: d["valves"][0].update(c_pa=0.0), "above 0"),
        (lambda d: d["valves"][0].update(deadband=-0.01), "should not be negative"),
        (lambda d: d["valves"][0].update(dead_band=0.01), "key 'dead_band' is unknown"),
        (lambda d: d["fluid"].update(low_pressure_loss=1.0), "below 1"),
        (lambda d: d["fluid"].update(bulk_modulus_pa="stiff"), "should be a number"),
        (lambda d: d["cylinders"][0].update(static_friction_n=1.0), "at least coulomb"),
        (lambda d: d["cylinders"][0]["rod"].pop("mass_kg"), "'mass_kg' is missing"),
        (lambda d: d["sensors"].update(pressure_bias_pa={"pump": 1.0}), "'pump' is unknown"),
        (lambda d: d.update(supply=[1]), "should be a mapping"),
    ],
)
def test_malformed_truths_are_named(
    robot: Robot, tmp_path: Path, change: Any, message: str
) -> None:
    with pytest.raises(HydroError, match=message) as caught:
        load_truth(_changed(tmp_path / "truth.yaml", change), robot)
    assert "\n" not in str(caught.value)
    assert "truth.yaml" in str(caught.value)


@pytest.mark.parametrize("name", ["nowhere.yaml", "random:", "random:x", "Realistic"])
def test_unknown_truths_list_the_known(robot: Robot, name: str) -> None:
    with pytest.raises(BridgeError, match=r"no truth .* ideal, random:SEED .*realistic"):
        load_truth(name, robot)


def _reference_path(robot: Robot) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Joint positions, rates and accelerations along the reference crane's parallelogram."""
    path = yaml.safe_load((Path(str(robot.source)).parent / "parallelogram.yaml").read_text())
    corners = np.array(path["corners_m"])
    step = 0.02
    for start, end, duration in zip(corners, corners[1:], path["durations_s"], strict=False):
        share = np.arange(0.0, duration, step) / duration
        way = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        q = np.array([joints_for_tip(robot, start + w * (end - start)) for w in way])
        qd = np.gradient(q, step, axis=0)
        yield from zip(q, qd, np.gradient(qd, step, axis=0), strict=True)


def test_realistic_supply_has_force_to_spare_on_the_reference_path(robot: Robot) -> None:
    """Piston force with friction against valve fully open at that speed, after the droop."""
    truth = load_truth("realistic", robot)
    plant = Plant(robot, truth, np.array([0.5, -1.5]))
    supply, margins = truth.supply, []
    for q, qd, qdd in _reference_path(robot):
        matrix, bias, lever = plant.equations(q, qd)
        load, speed = (matrix @ qdd + bias) / lever, lever * qd
        swept = [
            (c.area_a_m2 if v > 0 else c.area_b_m2) * abs(v)
            for c, v in zip(robot.cylinders, speed, strict=True)
        ]
        drawn = sum(swept)
        p_s = supply.pressure_pa - supply.droop * drawn - supply.droop_quadratic * drawn**2
        p_t = supply.tank_pressure_pa + supply.tank_resistance * drawn**2
        for i, cylinder in enumerate(robot.cylinders):
            real, valve, v = truth.cylinders[i], truth.valves[i], float(speed[i])
            needed = load[i] + real.viscous_friction * v + np.sign(v) * real.coulomb_friction_n
            a, b = cylinder.area_a_m2, cylinder.area_b_m2
            most = a * p_s - b * p_t
            least = a * p_t - b * p_s
            if v > 0.0:
                most -= a * (a * v / valve.c_pa) ** 2 + b * (b * v / valve.c_bt) ** 2
            else:
                least += b * (b * v / valve.c_pb) ** 2 + a * (a * v / valve.c_at) ** 2
            # Force left over, as a share of what there is on the side of the need.
            margins.append((most - needed) / most if v > 0.0 else (needed - least) / abs(least))
    assert min(margins) > 0.10
