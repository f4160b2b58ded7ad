"""Every public argument is described where someone who asks for help looks.

That is the docstring of its function or class, else that of the module, of a package around it
or of a module that one of these names in backquotes, where arguments are described that many
functions share. There a plain word is no description: names count between backquotes or in a list.
An argument whose name says its type (`robot: Robot`) has said all.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "hydro_model": ROOT / "ros2_ws/src/hydro_model/hydro_model",
    **{
        name: ROOT / name / name
        for name in ("hydro_msgs_docs", "hydro_hw_bridge", "hydro_control", "hydro_ident")
    },
}
#: Units that names end in; the text may give the name without.
_UNIT = re.compile(r"_(pa|s|m|n|v|hz|kg|rad|ns|ms|m3|pct|m_s|v_s|mm|cycles)$")
_RECORDS = ("dataclass", "NamedTuple", "TypedDict")


@dataclass(frozen=True)
class Argument:
    """An argument or a field: where, its name, its type, and the texts that may describe it.

    `shared` are those of modules and packages around it.
    """

    where: str
    name: str
    annotation: str
    text: str
    shared: str = ""

    @property
    def documented(self) -> bool:
        return (
            said(self.name, self.text)
            or said(self.name, self.shared, plain=False)
            or is_its_type(self.name, self.annotation)
        )


def said(name: str, text: str, *, plain: bool = True) -> bool:
    """Whether a text speaks of a name: in code, in a list, or unless short in plain words."""
    stem = _UNIT.sub("", name)
    if not plain or len(stem) < 3:
        code = " ".join(re.findall(r"`+([^`]+)`+", text))
        listed = re.findall(r"^[ -]*((?:\*{0,2}\w+, )*\*{0,2}\w+) ?:", text, re.M)
        return any(
            re.search(rf"\b{re.escape(one)}\b", " ".join([code, *listed]))
            for one in (name.rstrip("_"), stem.rstrip("_"))
        )
    words = {one for n in (name.rstrip("_"), stem) for one in (n, n.replace("_", " "))}
    return any(re.search(rf"\b{re.escape(one)}s?\b", text, re.I) for one in words)


def is_its_type(name: str, annotation: str) -> bool:
    """Whether a name is that of a class in its annotation, or the end of it, or many of it."""
    stem = _UNIT.sub("", name)
    singular = {
        stem,
        re.sub(r"s$", "", stem),
        re.sub(r"es$", "", stem),
        re.sub(r"ies$", "y", stem),
    }
    for word in re.findall(r"[A-Z]\w*", annotation):
        snake = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", word).lower()
        if any(f"_{snake}_".find(f"_{one}_") >= 0 for one in singular):
            return True
    return False


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def doc(node: ast.AST) -> str:
    assert isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
    return ast.get_docstring(node) or ""


def module_file(dotted: str) -> Path | None:
    """The file of a module that a text names, if it is one of ours."""
    package, *rest = dotted.split(".")
    if package not in PACKAGES:
        return None
    path = PACKAGES[package].joinpath(*rest)
    found = [p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()]
    return found[0] if found else None


@cache
def around(path: Path) -> str:
    """Docstrings of a module, of the packages around it, and of modules that it names."""
    text = doc(tree(path))
    folder = path.parent
    while (folder / "__init__.py").is_file():
        text += "\n" + doc(tree(folder / "__init__.py"))
        folder = folder.parent
    return text + named_in(text)


def named_in(text: str) -> str:
    files = {module_file(name) for name in re.findall(r"`((?:\w+\.)*\w+)`", text)}
    return "".join("\n" + doc(tree(path)) for path in files if path)


def arguments(path: Path) -> Iterator[Argument]:
    """Arguments of a module's public functions, methods and classes."""
    place = str(path.relative_to(ROOT))
    yield from _of_body(tree(path).body, place, "", path)


def _of_body(body: list[ast.stmt], where: str, text: str, path: Path) -> Iterator[Argument]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            own = f"{text}\n{doc(node)}{named_in(doc(node))}"
            yield from _of_record(node, f"{where}, {node.name}", own, path)
            yield from _of_body(node.body, f"{where}, {node.name}", own, path)
        elif isinstance(node, ast.FunctionDef) and _is_public(node):
            own = f"{text}\n{doc(node)}{named_in(doc(node))}"
            for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs):
                if a.arg not in ("self", "cls"):
                    type_ = ast.unparse(a.annotation) if a.annotation else ""
                    yield Argument(f"{where}, {node.name}", a.arg, type_, own, around(path))


def _is_public(node: ast.FunctionDef) -> bool:
    if any(ast.unparse(one).endswith(".setter") for one in node.decorator_list):
        return False  # the property's own text is the getter's
    return node.name == "__init__" or not node.name.startswith("_")


def _of_record(node: ast.ClassDef, where: str, text: str, path: Path) -> Iterator[Argument]:
    """Fields of a record: its constructor's arguments; a comment or a text beside counts."""
    heads = " ".join(ast.unparse(n) for n in (*node.decorator_list, *node.bases))
    if not any(kind in heads for kind in _RECORDS):
        return
    lines = path.read_text(encoding="utf-8").splitlines()
    for field, after in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        if field.target.id.startswith("_") or "ClassVar" in ast.unparse(field.annotation):
            continue
        beside = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if beside or "#:" in lines[field.lineno - 2] or "  # " in lines[field.end_lineno - 1]:
            continue
        type_ = ast.unparse(field.annotation)
        yield Argument(where, field.target.id, type_, text, around(path))


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_argument_is_described(package: str) -> None:
    found = [
        one
        for path in sorted(PACKAGES[package].rglob("*.py"))
        if not path.name.startswith("_") or path.name == "__init__.py"
        for one in arguments(path)
    ]
    assert len(found) > 40
    silent = [f"{one.where}: {one.name}" for one in found if not one.documented]
    assert not silent, "not described:\n" + "\n".join(silent)


@pytest.mark.parametrize(
    ("name", "annotation", "text", "documented"),
    [
        ("count", "int", "The first few.", False),
        ("count", "int", "The first few; `count`: how many.", True),
        ("step_s", "float", "Rows a step apart.", True),
        ("a", "float", "A sum of a few.", False),
        ("a", "float", "a : float\n    Lower end.", True),
        ("q", "FloatArray", "At `q` (n,).", True),
        ("robot", "Robot", "", True),
        ("effects", "Sequence[ActiveEffect]", "", True),
        ("robots", "Sequence[Machine]", "", False),
    ],
)
def test_what_counts_as_described(name: str, annotation: str, text: str, documented: bool) -> None:
    assert Argument("", name, annotation, text).documented is documented


@pytest.mark.parametrize(
    ("shared", "documented"),
    [
        ("How to count.", False),
        ("`count` is how many.", True),
        ("count : int\n    How many.", True),
        ("Shared arguments: count", False),
    ],
)
def test_a_plain_word_in_a_text_that_many_share_describes_nothing(
    shared: str, documented: bool
) -> None:
    assert Argument("", "count", "int", "Add some.", shared).documented is documented
