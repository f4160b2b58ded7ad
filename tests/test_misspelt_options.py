"""Every command says which option a misspelt one may have been meant for."""

from __future__ import annotations

from importlib.metadata import EntryPoint, distribution

import pytest

PACKAGES = ("hydro_model", "hydro_msgs_docs", "hydro_hw_bridge", "hydro_control", "hydro_ident")
COMMANDS = [
    entry
    for package in PACKAGES
    for entry in distribution(package).entry_points.select(group="console_scripts")
]


def test_there_are_commands() -> None:
    assert {"identify", "sim_rig", "can_bridge", "send_path"} <= {c.name for c in COMMANDS}


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c.name)
def test_a_misspelt_option_is_said_beside_the_one_that_was_meant(
    command: EntryPoint, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whatever else is wrong with the line, such as arguments that are missing."""
    monkeypatch.setattr("sys.argv", [command.name, "--hepl"])
    with pytest.raises(SystemExit) as ended:
        command.load()()
    assert ended.value.code == 2
    said = capfd.readouterr().err.splitlines()[-1]
    assert said.startswith(f"{command.name}: error: ")
    assert said.endswith("unknown option '--hepl', did you mean '--help'?")
