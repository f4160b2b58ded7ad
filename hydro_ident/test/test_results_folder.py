"""The command line that results name: it has every option that they depend on."""

from __future__ import annotations

from types import ModuleType

import pytest

from hydro_ident.commands import diagnose, identify
from hydro_ident.commands.results_folder import changed_options

#: The same input gives the same result wherever it is written and however it is worked out.
NOT_OF_THE_RESULT = {"help", "out", "json", "scheduler", "processes"}
#: Every option away from its default.
CHANGED = {
    identify: "--validate b c --compare old.yaml --hold-out 4 --estimator iv"
    " --differentiation-cutoff 20 --parallel-cutoff 7.5 --filter-order 3 --decimation 2",
    diagnose: "--validate b c --fixed-base --refine --longest 90.5",
}


@pytest.mark.parametrize("command", CHANGED, ids=lambda command: command.__name__)
def test_changed_options_read_back(command: ModuleType) -> None:
    needed, words = ["a", "--robot", "xs031", "--out", "x"], CHANGED[command].split()
    parser, names = command.parser(), command._RESULT_OPTIONS
    options = parser.parse_args([*needed, *words])
    assert changed_options(options, parser, names) == words
    assert changed_options(parser.parse_args(needed), parser, names) == []


@pytest.mark.parametrize("command", CHANGED, ids=lambda command: command.__name__)
def test_no_option_that_a_result_depends_on_is_forgotten(command: ModuleType) -> None:
    every = {action.dest for action in command.parser()._actions}
    assert every - NOT_OF_THE_RESULT == {"bags", "robot", *command._RESULT_OPTIONS}
