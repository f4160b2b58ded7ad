"""Puts a sabotage into a copy of the sources and sees whether its test notices."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from hydro_ident.errors import IdentError
from hydro_ident.study.sabotage.judge import ASSERTION, PASSED
from hydro_ident.study.sabotage.listed import Sabotage

#: The package that is copied and changed, from the repository's top.
PACKAGE = Path("hydro_ident/hydro_ident")


@dataclass(frozen=True, slots=True)
class End:
    """How a test ended.

    Attributes
    ----------
    end : str
        `passed`, `assertion`, `error` or `skipped`.
    message : str
        First line of what it raised.
    """

    end: str
    message: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one sabotage.

    Attributes
    ----------
    sabotage : Sabotage
    before : End
        Of its test on an unchanged copy.
    after : End or None
        With the sabotage; None where the test does not pass without it.
    """

    sabotage: Sabotage
    before: End
    after: End | None

    @property
    def caught(self) -> bool:
        """Whether the test passes without it, and fails by an assertion with it."""
        return self.after is not None and self.after.end == ASSERTION

    @property
    def text(self) -> str:
        """In a line."""
        if self.after is None:
            why = f"its test does not pass without it ({self.before.end}: {self.before.message})"
        elif self.caught:
            why = self.after.message
        elif self.after.end == PASSED:
            why = "its test passes all the same"
        else:
            why = f"its test ended without judging ({self.after.end}: {self.after.message})"
        return f"{'caught' if self.caught else 'MISSED'} {self.sabotage.name}: {why}"


def checked(root: Path, chosen: Sequence[Sabotage]) -> None:
    """See that every sabotage can be put into the sources as they are.

    Parameters
    ----------
    root : Path
        Top of the repository.
    chosen : sequence of Sabotage

    Raises
    ------
    IdentError
        A source text does not stand in its file exactly once, a replacement changes nothing or is
        no Python, or a test's file is missing.
    """
    problems = [text for one in chosen if (text := _problem(root, one))]
    if problems:
        raise IdentError("; ".join(problems))


def _problem(root: Path, one: Sabotage) -> str:
    path = root / PACKAGE / one.file
    if not path.is_file():
        return f"{one.name}: expected a source file {path}, found none"
    if not (root / one.test.partition("::")[0]).is_file():
        return f"{one.name}: expected its test in {root}, found no {one.test}"
    source = path.read_text(encoding="utf-8")
    found = source.count(one.text)
    if found != 1:
        return f"{one.name}: expected '{one.text}' once in {one.file}, found it {found} times"
    changed = source.replace(one.text, one.replacement)
    if changed == source:
        return f"{one.name}: expected a replacement that changes {one.file}, found the same text"
    try:
        compile(changed, str(path), "exec")
    except SyntaxError as error:
        return f"{one.name}: expected Python after the replacement in {one.file}, found {error}"
    return ""


@contextmanager
def copied(root: Path, one: Sabotage | None = None) -> Iterator[Path]:
    """A copy of the package in a folder of its own, with or without a sabotage.

    `root` is the folder of the sources.
    """
    with tempfile.TemporaryDirectory(prefix="sabotage-") as folder:
        copy = Path(folder).resolve()
        target = copy / PACKAGE.name
        shutil.copytree(root / PACKAGE, target, ignore=shutil.ignore_patterns("__pycache__"))
        if one is not None:
            path = target / one.file
            source = path.read_text(encoding="utf-8")
            path.write_text(source.replace(one.text, one.replacement), encoding="utf-8")
        yield copy


class Court:
    """A judge at work in a process of its own (see `judge`); ends with its `with` block.

    Parameters
    ----------
    root : Path
        Top of the repository.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def __enter__(self) -> Court:
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("judge.py"))],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def tested(self, copy: Path, tests: Sequence[str], modules: Sequence[str]) -> dict[str, End]:
        """Run tests on a copy of the package.

        Parameters
        ----------
        copy : Path
            Folder that holds the package.
        tests : sequence of str
        modules : sequence of str
            Those that have to come from the copy.

        Raises
        ------
        IdentError
            The tests did not end, or ran other sources than the copy's.
        """
        out = copy / "report.json"
        job = {"copy": str(copy), "root": str(self.root), "tests": list(tests)}
        job |= {"modules": list(modules), "out": str(out)}
        if self._process.stdin is None or self._process.stdout is None:
            raise IdentError("expected pipes to the judge's process, found none")
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        self._process.stdout.readline()
        if not out.is_file():
            raise IdentError(f"expected a report of {', '.join(tests)}, found none")
        report = json.loads(out.read_text(encoding="utf-8"))
        ends = {test: End(*end) for test, end in report["ends"].items()}
        judging = all(end.end in (PASSED, ASSERTION) for end in ends.values())
        for name in modules if judging else ():
            file = Path(report["imported"][name])
            if copy not in file.resolve().parents:
                raise IdentError(f"expected {name} to be imported from {copy}, found '{file}'")
        return ends


def outcomes(root: Path, chosen: Sequence[Sabotage]) -> Iterator[Outcome]:
    """Every sabotage's outcome, one after the other; every test is run unchanged once, before.

    `root` is the folder of the sources, `chosen` the tests that are run.

    Raises
    ------
    IdentError
        As `checked` and `Court.tested`.
    """
    checked(root, chosen)
    tests = list(dict.fromkeys(one.test for one in chosen))
    with Court(root) as court:
        with copied(root) as copy:
            before = court.tested(copy, tests, sorted({one.module for one in chosen}))
        for one in chosen:
            after = None
            if before[one.test].end == PASSED:
                with copied(root, one) as copy:
                    after = court.tested(copy, [one.test], [one.module])[one.test]
            yield Outcome(one, before[one.test], after)
