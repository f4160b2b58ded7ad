"""What a command refuses of a number is in the help of its option."""

from __future__ import annotations

import argparse

import pytest

from hydro_ident.commands import diagnose, excite
from hydro_ident.design.experiment import SHORTEST_S
from hydro_ident.mismatch.settings import LONGEST_SCAN_S


@pytest.mark.parametrize(
    ("parser", "option", "least"),
    [
        (excite.parser(), "--duration", SHORTEST_S),
        (diagnose.parser(), "--longest", LONGEST_SCAN_S),
    ],
)
def test_the_least_that_is_taken_is_said(
    parser: argparse.ArgumentParser, option: str, least: float
) -> None:
    [action] = [one for one in parser._actions if option in one.option_strings]
    assert f"{least:g} or more (default: %(default)g)" in str(action.help)
