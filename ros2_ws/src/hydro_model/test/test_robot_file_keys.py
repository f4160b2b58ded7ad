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
    source = shipped_robots()["xs031"]
    shutil.copy(source.parent / "xs031.urdf", tmp_path)
    data = yaml.safe_load(source.read_text(encoding="utf-8"))
    change(data)
    file = tmp_path / source.name
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    if expected is None:  # nothing of the kind is lacking: somebody else's key
        assert load_robot(file)
        return
    with pytest.raises(RobotError) as caught:
        load_robot(file)
    assert f"did you mean '{expected}'?" in str(caught.value)
