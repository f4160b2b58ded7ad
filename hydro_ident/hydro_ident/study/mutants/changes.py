"""Every small change of a source: the operators of cosmic-ray, and statements left out.

cosmic-ray (scripts/requirements-mutation.in) is imported where it is used; nothing else needs it.
"""

from __future__ import annotations

import ast
import importlib
import pickle
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any

from hydro_ident.errors import IdentError

#: What an operator of Python becomes: a comparison its neighbour and its opposite, an arithmetic
#: one its inverse. cosmic-ray has every other one, too; a test that tells a boundary and a
#: direction tells those, and they are ten for each.
_REPLACED = {
    "ReplaceComparisonOperator": (
        *("Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt"),
        *("Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is"),
    ),
    "ReplaceBinaryOperator": (
        *("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Div", "FloorDiv_Mul"),
        *("Mod_Mul", "Pow_Mul", "BitOr_BitAnd", "BitAnd_BitOr", "BitXor_BitOr"),
    ),
}
#: Operators that do nothing without arguments of their own.
_WITH_ARGUMENTS = ("VariableReplacer", "VariableInserter")
_LEFT_OUT = "LeaveOutStatement"


@dataclass(frozen=True, slots=True)
class Change:
    """One small change of a source.

    Attributes
    ----------
    operator : str
        What was changed, as cosmic-ray calls it.
    line : int
        The first that differs, from 1.
    where : str
        Class and function around it; empty at the top of the module.
    before, after : str
        What differs, without indentation.
    source : str
        The whole of it, changed.
    """

    operator: str
    line: int
    where: str
    before: str
    after: str
    source: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is known by, wherever its line moves."""
        return self.where, self.before, self.after


def changes(source: str) -> list[Change]:
    """Every change of a source that is another program.

    Left out are those of annotations, which nothing reads, and doubles.

    Parameters
    ----------
    source : str

    Raises
    ------
    IdentError
        cosmic-ray is not installed.
    """
    visitor = _module("cosmic_ray.mutating").MutationVisitor
    # Loaded for every change: many times faster than parsed anew.
    tree = pickle.dumps(_module("cosmic_ray.ast").get_ast(source))
    seen = {_meaning(source)}
    found = []
    for name, operator in _operators():
        for occurrence in count():
            visit = visitor(occurrence, operator)
            changed = visit.walk(pickle.loads(tree)).get_code()
            if not visit.mutation_applied:
                break
            try:
                meaning = _meaning(changed)
            except SyntaxError:
                continue  # no program at all
            if meaning not in seen:
                seen.add(meaning)
                found.append(_change(name, source, changed))
    return sorted(found, key=lambda one: (one.line, one.operator, one.after))


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise IdentError(
            f"expected cosmic-ray, found none ({error}): pip install -c requirements.lock"
            " -r scripts/requirements-mutation.in"
        ) from error


def _operators() -> Iterator[tuple[str, Any]]:
    plugins = _module("cosmic_ray.plugins")
    for name in plugins.operator_names():
        short = name.rpartition("/")[2]
        kind, _, which = short.partition("_")
        if short not in _WITH_ARGUMENTS and which in _REPLACED.get(kind, (which,)):
            yield short, plugins.get_operator(name)()
    yield _LEFT_OUT, _LeaveOutStatement()


class _LeaveOutStatement:
    """A statement in a line of its own becomes `pass`; in the form of cosmic-ray's operators."""

    def mutation_positions(self, node: Any) -> Iterator[tuple[Any, Any]]:
        if node.type != "simple_stmt":
            return
        if node.children[0].type not in ("string", "strings", "import_from", "import_name"):
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, _index: int) -> Any:
        tree = _module("parso.python.tree")
        first = node.children[0]
        nothing = tree.Keyword("pass", first.start_pos, first.get_first_leaf().prefix)
        node.children[0] = nothing
        return node


class _Meaning(ast.NodeTransformer):
    """Takes annotations and docstrings away."""

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)


def _meaning(source: str) -> str:
    return ast.dump(_Meaning().visit(ast.parse(source)))


def _change(operator: str, source: str, changed: str) -> Change:
    old, new = source.splitlines(), changed.splitlines()
    first = next(i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
    behind = 0
    while behind < min(len(old), len(new)) - first and old[-1 - behind] == new[-1 - behind]:
        behind += 1
    before, after = (
        " ".join(text.strip() for text in lines[first : len(lines) - behind])
        for lines in (old, new)
    )
    return Change(operator, first + 1, _where(source, first + 1), before, after, changed)


def _where(source: str, line: int) -> str:
    """The names of what stands around a line, outermost first."""
    names: list[str] = []
    nodes: list[ast.stmt] = ast.parse(source).body
    while nodes:
        inside = [
            node
            for node in nodes
            if isinstance(node, ast.ClassDef | ast.FunctionDef)
            and node.lineno - len(node.decorator_list) <= line <= (node.end_lineno or 0)
        ]
        names += [node.name for node in inside]
        nodes = inside[0].body if inside else []
    return ".".join(names)
