"""The command lines of nodes: what ROS takes, what nobody takes, a help with the parameters."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence

from hydro_model.command_line.command import Parser


def own_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments outside `--ros-args ... --`, found without importing ROS.

    Parameters
    ----------
    arguments : sequence of str
    """
    own, ros = [], False
    for argument in arguments:
        if argument == "--ros-args":
            ros = True
        elif ros and argument == "--":
            ros = False
        elif not ros:
            own.append(argument)
    return own


def check_arguments(
    name: str,
    description: str,
    parameters: Iterable[tuple[str, str, object]],
    arguments: Sequence[str],
) -> None:
    """Answer `--help`, and refuse by its name what neither the node nor ROS takes.

    Parameters
    ----------
    name : str
        Of the executable.
    description : str
    parameters : iterable of (str, str, object)
        Name, meaning and default of every ROS parameter; None: it has to be given.
    arguments : sequence of str

    Raises
    ------
    SystemExit
        Of argparse: 0 after the help, 2 for an unknown argument.
    """
    rows = list(parameters)
    width = max(len(row[0]) for row in rows)
    lines = [
        f"  {parameter:{width}}  {text} [{'required' if default is None else default}]"
        for parameter, text, default in rows
    ]
    Parser(
        prog=name,
        description=description,
        usage=f"{name} [-h] [--ros-args -p NAME:=VALUE ... | --params-file FILE]",
        epilog="parameters:\n" + "\n".join(lines),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    ).parse_args(own_arguments(arguments))
