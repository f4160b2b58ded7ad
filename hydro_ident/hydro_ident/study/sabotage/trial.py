"""Puts a sabotage into a copy of the sources and sees whether its test notices."""

from __future__ import annotations

import json
import os
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
#: Far longer than any of the tests takes, cold caches included.
_PATIENCE_S = 600.0


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
    """A copy of the package in a folder of its own, with or without a sabotage."""
    with tempfile.TemporaryDirectory(prefix="sabotage-") as folder:
        copy = Path(folder).resolve()
        target = copy / PACKAGE.name
        shutil.copytree(root / PACKAGE, target, ignore=shutil.ignore_patterns("__pycache__"))
        if one is not None:
            path = target / one.file
            source = path.read_text(encoding="utf-8")
            path.write_text(source.replace(one.text, one.replacement), encoding="utf-8")
        yield copy


def tested(root: Path, copy: Path, test: str, modules: Sequence[str]) -> End:
    """Run a test on a copy of the package.

    Parameters
    ----------
    root : Path
    copy : Path
        Folder that holds the package.
    test : str
    modules : sequence of str
        Those that have to come from the copy.

    Raises
    ------
    IdentError
        The test did not run, ran too long, or ran other sources than the copy's.
    """
    out = copy / "report.json"
    behind = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([str(copy), *([behind] if behind else [])])
    command = [sys.executable, "-m", "hydro_ident.study.sabotage.judge", test, str(out), *modules]
    try:
        done = subprocess.run(
            command, cwd=root, env={**os.environ, "PYTHONPATH": path}, capture_output=True,
            text=True, timeout=_PATIENCE_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise IdentError(f"expected {test} to end within {_PATIENCE_S:.0f} s") from None
    if not out.is_file():
        raise IdentError(f"expected a report of {test}, found none: {done.stderr.strip()[-400:]}")
    report = json.loads(out.read_text(encoding="utf-8"))
    for name in modules if report["end"] in (PASSED, ASSERTION) else ():
        file = Path(report["imported"][name])
        if copy not in file.resolve().parents:
            raise IdentError(f"expected {test} to import {name} from {copy}, found '{file}'")
    return End(report["end"], report["message"])


def outcomes(root: Path, chosen: Sequence[Sabotage]) -> Iterator[Outcome]:
    """Every sabotage's outcome, one after the other; a test is run unchanged once.

    Raises
    ------
    IdentError
        As `checked` and `tested`.
    """
    checked(root, chosen)
    before: dict[str, End] = {}
    for one in chosen:
        if one.test not in before:
            modules = sorted({o.module for o in chosen if o.test == one.test})
            with copied(root) as copy:
                before[one.test] = tested(root, copy, one.test, modules)
        after = None
        if before[one.test].end == PASSED:
            with copied(root, one) as copy:
                after = tested(root, copy, one.test, [one.module])
        yield Outcome(one, before[one.test], after)
