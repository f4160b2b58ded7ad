"""What every command line of the packages shares: one clear line on an error, and exit codes.

PYTHON_ARGCOMPLETE_OK: where argcomplete is installed and a shell asks for completions, they are
those of the parser that the command makes, and of shipped robots beside files where a robot is
wanted; nothing heavy has been imported by then.
"""

from __future__ import annotations

import argparse
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NoReturn

from hydro_model.command_line.output import let_go_of_stdout
from hydro_model.command_line.terminal import coloured
from hydro_model.errors import HydroError, printable

Main = Callable[[Sequence[str]], int]

#: Share of letters in common from which an option is taken for another one, misspelt.
_ALIKE = 0.7
#: What a value is that argparse cannot read, by the name of its type; of others it is that name.
_WANTED = {"int": "a whole number", "float": "a number"}
_VALUE = re.compile(r"(?<=: )invalid (\w+) value: ")


class Parser(argparse.ArgumentParser):
    """A parser whose errors say which option an unknown one may have been meant for.

    That of every command line of the packages, and of their subcommands.
    """

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As of argparse; what was given is kept for errors.

        `args` are the words, by default the process's own; `namespace` is filled, or a new one.
        """
        self._given = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(self._given, namespace)

    def error(self, message: str) -> NoReturn:
        """One line: as of argparse without the usage, and what is unknown beside what was meant.

        `message` says what is wrong: a required option that is misspelt is missing, too.
        """
        hints = list(self._hints()) or [f"see {self.prog} --help"]
        said = printable("; ".join([_VALUE.sub(_found, message), *hints]))
        self.exit(2, f"{self.prog}: error: {said}\n")

    def _hints(self) -> Iterator[str]:
        from difflib import get_close_matches

        known = sorted(_options(self))
        given = getattr(self, "_given", [])
        # Behind -- nothing is an option; before =, its value.
        ends = given.index("--") if "--" in given else len(given)
        for word in dict.fromkeys(w.partition("=")[0] for w in given[:ends]):
            unknown = word.startswith("--") and not any(one.startswith(word) for one in known)
            meant = get_close_matches(word, known, 1, _ALIKE) if unknown else []
            if meant:
                yield f"unknown option '{word}', did you mean '{meant[0]}'?"


def _found(match: re.Match[str]) -> str:
    return f"expected {_WANTED.get(match[1], match[1])}, found "


def _options(parser: argparse.ArgumentParser) -> set[str]:
    """The long options of a parser and of its subcommands."""
    found = {word for word in parser._option_string_actions if word.startswith("--")}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                found |= _options(sub)
    return found


def warn(name: str, warnings: Iterable[str]) -> None:
    """Say on standard error what a result is to be read with, a line for each.

    Parameters
    ----------
    name : str
        The command's.
    warnings : iterable of str
    """
    for warning in warnings:
        said = coloured("warning", "yellow", sys.stderr)
        print(f"{name}: {said}: {printable(warning)}", file=sys.stderr, flush=True)


def run_command(name: str, main: Main, arguments: Sequence[str] | None = None) -> int:
    """Run a command's body and turn what it raises into a line on stderr and an exit code.

    Parameters
    ----------
    name : str
        The command's name, printed before the message.
    main : callable
        Takes the arguments and returns the exit code.
    arguments : sequence of str, optional
        By default the process's own.

    Returns
    -------
    int
        0 done; 1 the work failed, or memory ended; 2 bad usage or unreadable input; 130 on Ctrl-C.
    """
    if "_ARGCOMPLETE" in os.environ:
        _complete_words()
    # What a library says in passing, such as of a robot file's limits, is the command's to say.
    logging.basicConfig(format=f"{name}: warning: %(message)s")
    try:
        return main(list(sys.argv[1:] if arguments is None else arguments))
    except HydroError as error:
        said = printable(str(error))
        print(f"{coloured(name, 'red', sys.stderr)}: {said}", file=sys.stderr)
        return error.exit_code
    except MemoryError as error:
        said = printable(" ".join(str(error).split()))
        print(f"{coloured(name, 'red', sys.stderr)}: out of memory: {said}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        let_go_of_stdout()
        return 0


def _complete_words() -> None:
    """Answer the shell, in the process that it started for completions, with the first parser."""
    try:
        import argcomplete
    except ImportError:
        return
    from hydro_model.description.shipped import shipped_robots

    parse = argparse.ArgumentParser.parse_args

    def robots(prefix: str, **words: Any) -> list[str]:
        names = [name for name in shipped_robots() if name.startswith(prefix)]
        return [*names, *argcomplete.completers.FilesCompleter()(prefix, **words)]

    def answer(self: argparse.ArgumentParser, *args: Any, **kwargs: Any) -> Any:
        for action in self._actions:
            if action.dest == "robot":
                action.completer = robots  # type: ignore[attr-defined]
        argcomplete.autocomplete(self)  # does not return where the shell asks
        return parse(self, *args, **kwargs)

    argparse.ArgumentParser.parse_args = answer  # type: ignore[method-assign]
