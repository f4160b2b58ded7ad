"""What `identify` and `diagnose` share: a result's origin, its folder and its exit code."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydro_model.command_line.output import STDOUT, report

if TYPE_CHECKING:
    from hydro_ident.identify.results import Provenance
    from hydro_ident.recordings.sources import BagSource
    from hydro_model.robot import Robot


def changed_options(
    options: argparse.Namespace, defaults: argparse.ArgumentParser, names: Sequence[str]
) -> list[str]:
    """Options that are not at their defaults, as on a command line.

    Parameters
    ----------
    options : Namespace
        What argparse made of a command line.
    defaults : ArgumentParser
        The command's own.
    names : sequence of str
        Fields of `options`, in the order of the line.

    Returns
    -------
    list of str
    """
    return [
        word
        for name in names
        if getattr(options, name) != defaults.get_default(name)
        for word in ("--" + name.replace("_", "-"), *_words(getattr(options, name)))
    ]


def _words(value: bool | float | str | Sequence[str]) -> list[str]:
    """What stands behind an option's name: nothing behind a flag's."""
    if isinstance(value, bool):
        return []
    if isinstance(value, (int, float)):
        return [f"{value:g}"]
    return [value] if isinstance(value, str) else list(value)


def origin_of(
    options: argparse.Namespace,
    defaults: argparse.ArgumentParser,
    names: Sequence[str],
    sources: tuple[Sequence[BagSource], Sequence[BagSource]],
    robots: tuple[Robot, Robot | None],
) -> Provenance:
    """Where a result comes from.

    The same input gives the same result wherever it is written and however it is worked out:
    folder, processes and cluster are not in it.

    Parameters
    ----------
    options : Namespace
        With `bags` and `robot`.
    defaults : ArgumentParser
        The command's own; its `prog` is the command's name.
    names : sequence of str
        Of the other options that the result depends on.
    sources : tuple
        Of the bags learnt from, and of those that predictions are scored on.
    robots : tuple
        The one that was read, and an earlier model to compare with.

    Returns
    -------
    Provenance

    Raises
    ------
    IdentError
        As `hydro_ident.identify.origin.provenance`.
    """
    from hydro_ident.identify.origin import provenance

    changed = changed_options(options, defaults, names)
    command = [defaults.prog, *options.bags, "--robot", options.robot, *changed]
    learnt, scored = ({source.name: source.path for source in given} for given in sources)
    return provenance(shlex.join(command), options.robot, learnt, scored, *robots)


def write_files(
    folder: Path,
    result: str,
    report_html: Callable[[], str],
    write_robot: Callable[[Path], None] | None,
) -> None:
    """Write every result file, or none; the report where what draws it is installed.

    Parameters
    ----------
    folder : Path
    result : str
        Text of `result.json`.
    report_html : callable
        Makes the text of `report.html`.
    write_robot : callable or None
        As of `hydro_ident.identify.results.write_outcome`.

    Raises
    ------
    IdentError
        The folder cannot be written; what was there stays.
    """
    from hydro_ident.identify.results import write_outcome
    from hydro_ident.optional import installed

    drawn = report_html() if installed("plotly") else None
    write_outcome(folder, result, drawn, write_robot)


def deliver(
    name: str,
    options: argparse.Namespace,
    write: Callable[[Path], None],
    told: tuple[Mapping[str, Any], str],
    problems: Sequence[str] | None,
) -> int:
    """Write a result into its folder and tell it.

    Parameters
    ----------
    name : str
        Of the command.
    options : Namespace
        With `out` and `json`.
    write : callable
        Writes every result file into a folder.
    told : tuple
        `result.json`'s content, and the result as text for the terminal.
    problems : sequence of str or None
        Why the data were not enough; None where they were.

    Returns
    -------
    int
        The command's exit code.

    Raises
    ------
    IdentError, OutputError
        The folder, or the file of `--json`, cannot be written.
    """
    from hydro_ident.identify.earlier_result import earlier_result

    earlier = earlier_result(options.out)
    write(options.out)
    if earlier:
        print(f"{name}: replaced in {options.out}: the result of {earlier}", file=sys.stderr)
    report(options.json, *told)
    if problems is not None:
        print(f"{name}: {'; '.join(problems)}", file=sys.stderr)
        return 1
    if options.json != STDOUT:
        print(f"written: {options.out}")
    return 0
