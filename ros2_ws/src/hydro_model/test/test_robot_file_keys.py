"""Keys of robot files that are known ones misspelt."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from hydro_model.errors import RobotError
from hydro_model.robot_files import load_robot, shipped_robots

Change = Callable[[dict[str, Any]], None]


def misspelt(*way: str | int, right: str, wrong: str) -> Change:
    def change(data: dict[str, Any]) -> None:
        at: Any = data
        for step in way:
            at = at[step]
        at[wrong] = at.pop(right, 1.0)

    return change


def changed(folder: Path, change: Change) -> Path:
    """The shipped robot's file with a change."""
    source = shipped_robots()["xs031"]
    shutil.copy(source.parent / "xs031.urdf", folder)
    data = yaml.safe_load(source.read_text(encoding="utf-8"))
    change(data)
    file = folder / source.name
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (misspelt("valves", 0, right="rated_voltage_v", wrong="rated_voltage"), "rated_voltage_v"),
        (misspelt("fluid", right="bulk_modulus_pa", wrong="bulk_modulus"), "bulk_modulus_pa"),
        (misspelt(right="command_delay_s", wrong="comand_delay_s"), "command_delay_s"),
        (misspelt(right="gravity_m_s2", wrong="gravity"), "gravity_m_s2"),
        (misspelt(right="effects", wrong="efects"), "effects"),
        (misspelt("cylinders", 0, right="barrel", wrong="barel"), "barrel"),
        (misspelt("cylinders", 0, "rod", right="mass", wrong="mass"), None),
        (misspelt("sensors", right="rate_hz", wrong="rate"), "rate_hz"),
    ],
)
def test_a_key_that_is_another_one_misspelt_is_refused(
    tmp_path: Path, change: Change, expected: str | None
) -> None:
    """It would be left out, and the default stand in its place."""
    file = changed(tmp_path, change)
    if expected is None:  # nothing of the kind is lacking: somebody else's key
        assert load_robot(file)
        return
    with pytest.raises(RobotError) as caught:
        load_robot(file)
    assert f"did you mean '{expected}'?" in str(caught.value)


@pytest.mark.parametrize(
    ("way", "said"),
    [
        (("sensors",), "expected encoder, pressure, rate_hz"),
        (("sensors", "encoder"), "expected counts_per_rev"),
        (("sensors", "pressure"), "expected range_pa, resolution_pa"),
    ],
)
def test_nothing_else_stands_below_sensors(
    tmp_path: Path, way: tuple[str, ...], said: str
) -> None:
    """What an encoder or transducer has, put a level too high, would count for nothing."""
    unknown = misspelt(*way, right="none", wrong="encoder_counts_per_rev")
    with pytest.raises(RobotError, match="unknown key 'encoder_counts_per_rev', ") as caught:
        load_robot(changed(tmp_path, unknown))
    assert str(caught.value).endswith(said)
