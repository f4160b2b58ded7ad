"""Every command in the pages exists and takes the arguments that the pages give it.

What runs it stands in docs_commands.yaml: a test, or a person and why. Every line of a block of
shell commands counts, whatever it begins with: those of other people's programs stand there, too.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import importlib.util
import io
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "hydro_model": ROOT / "ros2_ws/src/hydro_model",
    **{
        p: ROOT / p for p in ("hydro_msgs_docs", "hydro_hw_bridge", "hydro_control", "hydro_ident")
    },
}
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "hydro_msgs_docs").rglob("*.md")),
]
TABLE = ROOT / "tests/docs_commands.yaml"
#: Nodes: they take ROS parameters, which other tests compare with the pages.
NODES = {"can_bridge", "controller", "identification_node", "visual_joints"}
#: Languages of fenced blocks in the pages; one without any could hide a command.
LANGUAGES = {"bash", "text", "yaml", "xml", "python", "math", "mermaid"}
_START = (
    r"(?:ros2 (?:run|service|bag) |\$\(hydro_exe |(?:\./)?scripts/\w+\.(?:sh|py)\b|python -m )"
)


class Parsed(BaseException):
    """Arguments were taken; the work itself is not what is tested here."""


@dataclass(frozen=True)
class Shown:
    """A command as a page shows it."""

    page: str
    line: str

    def words(self, alternative: int = 0) -> list[str]:
        """Its words, with what may be left out, without brackets; numbers for their letters."""
        line = re.sub(r"\$\(hydro_exe (\w+) (\w+)\)", r"ros2 run \1 \2", self.line)
        # The bare names are those of scripts/completion.sh.
        line = re.sub(r"^\w+(?= )", lambda name: _BARE.get(name[0], name[0]), line)
        line = re.sub(r"\[([^]|]*)\|([^]]*)\]", rf"\{alternative + 1}", line)
        words = [word.strip("[]") for word in shlex.split(line) if word.strip("[]")]
        words = words[: words.index(">")] if ">" in words else words
        return ["1" if re.fullmatch("[A-Z]", word) else word for word in words]


def executables() -> dict[tuple[str, str], str]:
    """(package, executable) to the function that it runs, from the packages' set-up files."""
    found = {}
    for package, folder in PACKAGES.items():
        text = (folder / "setup.py").read_text(encoding="utf-8")
        for name, module, function in re.findall(r'"(\w+) = ([\w.]+):(main)"', text):
            found[package, name] = f"{module}:{function}"
    return found


#: Bare name to what it stands for.
_BARE = {name: f"ros2 run {package} {name}" for package, name in executables()}


def blocks(text: str) -> Iterator[tuple[str, str]]:
    """Fenced blocks as (language, content), indented ones (in lists) too."""
    pattern = r"^( *)```(\w*)\n(.*?)^\1```"
    for indent, language, body in re.findall(pattern, text, re.M | re.S):
        yield language, re.sub(rf"^{indent}", "", body, flags=re.M)


def indented(text: str) -> Iterator[str]:
    """Blocks by indentation: four spaces or more after an empty line, outside of lists."""
    plain = re.sub(r"^ *```.*?^ *```", "", text, flags=re.M | re.S)
    for before, body in re.findall(r"^(.*)\n\s*\n((?: {4,}.+\n?|\n(?= {4}))+)", plain, re.M):
        # In a list, that is a paragraph of its item.
        if not re.match(r" *([-*]|\d+\.) | {2,}", before):
            yield re.sub(r"^ {4}", "", body, flags=re.M)


def shown_commands() -> list[Shown]:
    """Commands in blocks, indented lines and code spans of the pages."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        shell = [body for kind, body in blocks(text) if kind == "bash"] + [*indented(text)]
        lines = [ln for body in shell for ln in _joined(body)]
        plain = re.sub(r"^ *```bash.*?^ *```", "", text, flags=re.M | re.S)
        lines += re.findall(rf"^ *({_START}.*)$", plain, re.M)
        lines += re.findall(rf"`({_START}[^`]*)`", plain)
        plain_lines = (re.sub(r"\s#\s.*", "", line) for line in lines)
        found += [Shown(page.name, one.strip()) for ln in plain_lines for one in ln.split(" && ")]
    return list(dict.fromkeys(one for one in found if one.line))


def _joined(body: str) -> list[str]:
    lines = body.replace("\\\n", " ").splitlines()
    return [line for line in lines if not line.lstrip().startswith("#")]


def run_parser(run: Callable[[], Any], name: str, arguments: Sequence[str]) -> str:
    """Run a command until it has parsed its arguments; what it printed before that.

    Fails where it refuses them.
    """
    parse = argparse.ArgumentParser.parse_args

    def stop(self: argparse.ArgumentParser, *args: Any, **kwargs: Any) -> NoReturn:
        self.allow_abbrev = False  # pages write options out
        parse(self, *args, **kwargs)
        raise Parsed

    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", stop)
        patch.setattr(sys, "argv", [name, *arguments])
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            try:
                run()
            except Parsed:
                return said.getvalue()
            except SystemExit as end:
                code = end.code
            else:
                code = 0
    assert code in (0, None), said.getvalue()
    return said.getvalue()


def entry(package: str, name: str) -> Callable[[], Any]:
    known = executables()
    assert (package, name) in known, f"no executable {package} {name}"
    module, function = known[package, name].split(":")
    run: Callable[[], Any] = getattr(importlib.import_module(module), function)
    return run


@cache
def help_of(package: str, name: str) -> str:
    return run_parser(entry(package, name), name, ["--help"])


def script_help(script: Path) -> str:
    """What a script says of itself, with the help of the command that it hands over to."""
    runner = ["bash"] if script.suffix == ".sh" else [sys.executable]
    done = subprocess.run([*runner, str(script), "--help"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    text = script.read_text(encoding="utf-8")
    handed = re.findall(r'exec "\$\(hydro_exe (\w+) (\w+)\)"', text)
    return done.stdout + "".join(help_of(*both) for both in handed)


def options(words: Sequence[str]) -> set[str]:
    return {re.split(r"[=|]", word)[0] for word in words if re.match(r"--?[a-z]", word)}


def check_script(words: list[str]) -> None:
    script = ROOT / words[0]
    assert script.is_file(), f"no {words[0]}"
    if script.name in ("env.sh", "completion.sh"):  # sourced
        assert len(words) == 1
        return
    if script.name == "test.sh":
        assert options(words[1:]) <= {"--all", "-m", "-n", "-s", "-x", "--help"}
        return
    told = script_help(script)
    for option in options(words[1:]):
        assert re.search(rf"(?<![\w-]){re.escape(option)}(?![\w-])", told), f"no {option}: {told}"


def check_module(words: list[str]) -> None:
    spec = importlib.util.find_spec(words[0])
    assert spec is not None, f"no module {words[0]}"
    if spec.submodule_search_locations:
        spec = importlib.util.find_spec(f"{words[0]}.__main__")
    assert spec is not None, f"{words[0]} does not run"
    assert spec.origin is not None
    if "Parser(" not in Path(spec.origin).read_text(encoding="utf-8"):
        assert not options(words[1:]), f"{words[0]} takes no options"
        return
    run_parser(lambda: runpy.run_module(words[0], run_name="__main__"), words[0], words[1:])


def check_executable(package: str, name: str, arguments: list[str]) -> None:
    entry(package, name)
    if name in NODES:
        ros = {"--ros-args", "-p", "-r", "--params-file", "--enclave"}
        assert options(arguments) <= {*ros, "--help"}
    elif arguments:
        run_parser(entry(package, name), name, arguments)


@cache
def table() -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return found


SHOWN = shown_commands()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_block_of_a_page_says_what_language_it_is_in(page: Path) -> None:
    kinds = {kind for kind, _ in blocks(page.read_text(encoding="utf-8"))}
    assert kinds <= LANGUAGES


def test_every_line_of_a_block_counts_whatever_it_begins_with() -> None:
    page = "Text:\n\n    frobnicate --all\n    # why\n\n    ls\n\n- item\n\n    more of it\n"
    (body,) = indented(page)
    assert [line for line in _joined(body) if line] == ["frobnicate --all", "ls"]
    with pytest.raises(AssertionError, match="nobody checks 'frobnicate --all'"):
        check(Shown("page.md", "frobnicate --all"), ["frobnicate", "--all"])


def test_pages_show_commands() -> None:
    assert len(SHOWN) > 50


@pytest.mark.parametrize("shown", SHOWN, ids=lambda s: f"{s.page}: {s.line[:60]}")
@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
def test_shown_command_takes_its_arguments(shown: Shown) -> None:
    for words in {tuple(shown.words(alternative)) for alternative in (0, 1)}:
        check(shown, list(words))


def check(shown: Shown, words: list[str]) -> None:
    if words[:2] == ["ros2", "run"] and words[2] in PACKAGES:
        check_executable(words[2], words[3], words[4:])
    elif words[:2] == ["python", "-m"]:
        check_module(words[2:])
    elif name_of(words):
        check_script(words[1:] if words[0] == "source" else words)
    else:
        assert foreign(shown), f"{shown.page}: nobody checks '{shown.line}'"
        for word in words[1:]:
            if word.startswith(("hydro_msgs_docs/", "scripts/")):
                assert (ROOT / word).exists(), word


def foreign(shown: Shown) -> list[str]:
    """Beginnings in the table of other people's commands that a shown one has."""
    return [one for one in table()["foreign"] if re.match(rf"{re.escape(one)}(?!\w)", shown.line)]


def name_of(words: Sequence[str]) -> str:
    """What a shown command is called in the table; empty for other people's."""
    if words[:2] == ["ros2", "run"] and words[2] in PACKAGES:
        return f"{words[2]} {words[3]}"
    if words[:2] == ["python", "-m"]:
        return words[2]
    script = words[1] if words[0] == "source" else words[0]
    found = re.fullmatch(r"(?:\./)?(scripts/\S+)", script)
    return found[1] if found else ""


def test_every_shown_command_is_run_by_a_test_or_says_why_not() -> None:
    run, by_hand = set(table()["run"]), set(table()["by_hand"])
    assert run & by_hand == set()
    assert run | by_hand == {name for shown in SHOWN if (name := name_of(shown.words()))}


def test_other_peoples_commands_are_shown_and_say_why_no_test_runs_them() -> None:
    met = [one for shown in SHOWN if not name_of(shown.words()) for one in foreign(shown)]
    assert set(met) == set(table()["foreign"])
    assert all(len(why.split()) >= 3 for why in table()["foreign"].values())


@pytest.mark.parametrize(
    "named",
    sorted(set(table()["run"].values())),
)
def test_the_test_that_runs_a_command_exists(named: str) -> None:
    file, name = named.split("::")
    [path] = [p for root in (ROOT / "tests", *PACKAGES.values()) for p in root.rglob(file)]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert name in {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}


def test_what_is_said_of_commands_run_by_hand_is_there() -> None:
    places = (ROOT / "tests", ROOT / "hydro_msgs_docs", *PACKAGES.values())
    of_others = table()["foreign"]
    for name, why in (table()["by_hand"] | of_others).items():
        for file in re.findall(r"\w+\.(?:py|md)\b", why):
            found = [path for place in places for path in place.rglob(file)]
            found += [path for path in PAGES if path.name == file]
            assert found, f"{name}: no {file}"
            shown = name in found[0].read_text(encoding="utf-8")
            assert shown or file.endswith(".py") or name in of_others, f"{file}: no {name}"


def test_who_drives_a_bus_says_with_which_calibration() -> None:
    help_lines = (ROOT / "scripts/bringup.sh").read_text(encoding="utf-8").splitlines()[:10]
    lines = [line for page in PAGES for line in page.read_text(encoding="utf-8").splitlines()]
    driving = [ln for ln in lines + help_lines if "--can " in ln and "--drive" in ln]
    assert len(driving) >= 6
    silent = [ln for ln in driving if not re.search(r"--calibration \w|--no-calibration", ln)]
    assert not [ln for ln in silent if "bringup.sh" in ln]


@pytest.mark.parametrize(("package", "name"), sorted(executables()))
def test_every_command_takes_json(package: str, name: str) -> None:
    # Nodes and the simulated machine say what they do on topics and on the bus.
    silent = name in {*NODES, "sim_rig"}
    assert ("--json F" in help_of(package, name)) != silent
    for page in ("README.md", "hydro_msgs_docs/architecture.md"):
        text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
        (but,) = re.findall(r"Every command of a package but (.*?) takes `--json F`", text)
        assert (f"`{name}`" in but) == silent, page


def studies() -> list[str]:
    """Modules of studies and benches that take arguments of their own."""
    home = PACKAGES["hydro_ident"] / "hydro_ident"
    files = [path for part in ("study", "bench") for path in sorted((home / part).rglob("*.py"))]
    texts = {path: path.read_text(encoding="utf-8") for path in files}
    modules = [
        ".".join(path.relative_to(home.parent).with_suffix("").parts)
        for path, text in texts.items()
        if "Parser(" in text and ("__main__" in text or path.stem == "__main__")
    ]
    return [name.removesuffix(".__main__") for name in modules]


@pytest.mark.parametrize(("package", "name"), sorted(executables()))
def test_every_executable_has_help_and_says_what_its_arguments_are(
    package: str, name: str
) -> None:
    check_helps(entry(package, name), name)


@pytest.mark.parametrize("name", studies())
@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
def test_every_study_has_help_and_says_what_its_arguments_are(name: str) -> None:
    check_helps(lambda: runpy.run_module(name, run_name="__main__"), name)


def test_studies_are_found() -> None:
    """Modules, packages that run, and benches."""
    found = {f"hydro_ident.{name}" for name in ("study.kills", "study.faults", "bench.soak")}
    assert found <= set(studies())


def check_helps(run: Callable[[], Any], name: str) -> None:
    """A command's help is there, and says something of every argument, choices or not."""
    parsers: list[argparse.ArgumentParser] = []
    made = argparse.ArgumentParser.__init__

    def keep(self: argparse.ArgumentParser, *args: Any, **kwargs: Any) -> None:
        made(self, *args, **kwargs)
        parsers.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "__init__", keep)
        said = run_parser(run, name, ["--help"])
    assert said.startswith("usage:")
    for parser in parsers:
        # Commands of a command have a help text each, and that is where their choice is told.
        told = [a for a in parser._actions if not isinstance(a, argparse._SubParsersAction)]
        silent = [a.dest for a in told if not a.help]
        assert not silent, f"{name}: no help for {', '.join(silent)}"
