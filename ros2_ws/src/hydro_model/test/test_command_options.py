"""What a command line says of options that it does not know."""

from __future__ import annotations

import pytest

from hydro_model.command_line.command import Parser


def parser() -> Parser:
    made = Parser(prog="drive")
    made.add_argument("--robot", required=True)
    made.add_argument("--seed", type=int)
    made.add_argument("--max-speed", type=float)
    sub = made.add_subparsers(dest="what")
    sub.add_parser("hold").add_argument("--height", type=float)
    return made


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as ended:
        parser().parse_args(words)
    assert ended.value.code == 2
    return capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "unknown", "meant"),
    [
        (("--robot", "x", "--sede", "3"), "--sede", "--seed"),
        (("--robot", "x", "--sede=3"), "--sede", "--seed"),
        (("--robto", "x"), "--robto", "--robot"),
        (("--robot", "x", "--max_speed", "3"), "--max_speed", "--max-speed"),
        (("--robot", "x", "hold", "--hieght", "3"), "--hieght", "--height"),
        (("--robot", "x", "--seed", "3", "--sede", "4", "--sede", "5"), "--sede", "--seed"),
    ],
)
def test_it_says_what_was_meant(
    words: tuple[str, ...], unknown: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    line = said(capsys, *words)
    assert line.endswith(f"; unknown option '{unknown}', did you mean '{meant}'?")
    assert line.count("did you mean") == 1


def test_of_several_each_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    line = said(capsys, "--robto", "x", "--max-sped", "3")
    assert "'--robto', did you mean '--robot'?" in line
    assert "'--max-sped', did you mean '--max-speed'?" in line


@pytest.mark.parametrize(
    "words",
    [
        ("--robot", "x", "--colour", "red"),  # like none
        ("--robot", "x", "--seed", "many"),  # known, its value is wrong
        ("--robot", "x", "--", "--sede"),  # no option
        ("--robot", "x", "sede"),
        ("--se", "3"),  # argparse takes what an option begins with
    ],
)
def test_where_nothing_was_misspelt_nothing_is_guessed(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "did you mean" not in said(capsys, *words)


def test_what_was_given_commands_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    line = said(capsys, "--robot", "x", "--seed\x1b[2J", "3")
    assert "\x1b" not in line
    assert line.endswith(r"unknown option '--seed\x1b[2J', did you mean '--seed'?")


def test_a_right_line_is_taken_as_it_was() -> None:
    found = parser().parse_args(["--robot", "x", "--seed", "3", "hold", "--height", "2"])
    assert (found.robot, found.seed, found.what, found.height) == ("x", 3, "hold", 2.0)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ("--robot", "x", "--seed", "abc"),
            "argument --seed: expected a whole number, found 'abc'; see drive --help",
        ),
        (
            ("--robot", "x", "--max-speed", "fast"),
            "argument --max-speed: expected a number, found 'fast'; see drive --help",
        ),
        ((), "the following arguments are required: --robot; see drive --help"),
    ],
)
def test_an_error_is_one_line_that_says_what_to_try(
    words: tuple[str, ...], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It had been up to six of usage, and then `invalid int value: 'abc'`."""
    with pytest.raises(SystemExit):
        parser().parse_args(words)
    assert capsys.readouterr().err == f"drive: error: {line}\n"


def test_an_error_of_a_subcommand_is_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    line = said(capsys, "--robot", "x", "hold", "--height", "high")
    text = "argument --height: expected a number, found 'high'; see drive hold --help"
    assert line == f"drive hold: error: {text}"
