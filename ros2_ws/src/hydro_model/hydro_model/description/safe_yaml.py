"""YAML from anywhere: nothing in it is executed, and nothing grows beyond its file.

On top of PyYAML's safe loader, which makes no objects but plain ones: aliases are counted at the
size to which they unfold before anything is made of them, numbers have an end, and a key that
stands twice in a mapping is an error instead of a choice.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.parser import Parser
from yaml.reader import Reader
from yaml.resolver import Resolver
from yaml.scanner import Scanner

from hydro_model.errors import in_short

#: Values that stand in a document: that many cost a second. The covariance of 150 parameters, the
#: largest thing that a robot's file has, is 22 500 of them.
MAX_NODES = 50_000
#: Values that a document may unfold to.
MAX_VALUES = 1_000_000
_MAX_DIGITS = 400


class UnusableYamlError(ValueError):
    """A text that is no YAML, or none that is safe to take; one line."""


class _PythonEvents(Reader, Scanner, Parser):
    """What stands in a text, piece by piece, where PyYAML was built without libyaml."""

    def __init__(self, text: str) -> None:
        Reader.__init__(self, text)
        Scanner.__init__(self)
        Parser.__init__(self)


_Events: Any = _PythonEvents
if yaml.__with_libyaml__:  # reads robot files three to six times as fast
    from yaml._yaml import CParser as _Events


class _Loader(Composer, _Events, SafeConstructor, Resolver):  # type: ignore[misc]
    """PyYAML's safe loader with an end to what values, aliases, merge keys and numbers cost.

    libyaml's events alone: its composer composes all of a file before one can look.
    """

    def __init__(self, text: str, most_nodes: int) -> None:
        _Events.__init__(self, text)
        for part in (Composer, SafeConstructor, Resolver):
            part.__init__(self)
        self._nodes, self._most_nodes = 0, most_nodes

    def compose_node(self, parent: Any, index: Any) -> Any:
        # Counted while they are met: what stands behind is neither parsed nor kept.
        self._nodes += 1
        if self._nodes > self._most_nodes:
            raise UnusableYamlError(f"more than {self._most_nodes} values")
        return super().compose_node(parent, index)

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _check_size(node)
        return node

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        # Numbers to base 60 (`1:59:59`) take time with the square of their length.
        if len(node.value) > _MAX_DIGITS:
            raise yaml.constructor.ConstructorError(
                None, None, f"a number of more than {_MAX_DIGITS} digits", node.start_mark
            )
        return int(super().construct_yaml_int(node))


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def parse(text: str, most_nodes: int = MAX_NODES) -> Any:
    """What a YAML text says, as plain Python values.

    Parameters
    ----------
    text : str
    most_nodes : int
        Values that may stand in it.

    Returns
    -------
    object
        None, bool, int, float, str, date, list, dict ...

    Raises
    ------
    UnusableYamlError
        Not YAML, a tag that asks for another object, more values than may be, aliases that unfold
        to more than `MAX_VALUES` of them or contain themselves, a key twice in one mapping.

    Examples
    --------
    >>> parse("a: [1, 2.5]")
    {'a': [1, 2.5]}
    """
    try:
        loader = _Loader(text, most_nodes)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
    except UnusableYamlError:
        raise
    except RecursionError as error:
        raise UnusableYamlError("nested too deeply") from error
    except (yaml.YAMLError, ValueError, ArithmeticError, LookupError, AttributeError) as error:
        # PyYAML's own constructors look up and take apart what a tag promises and is not there.
        raise UnusableYamlError(_said(error)) from error


def _said(error: Exception) -> str:
    """PyYAML's reason and its line, without the piece of the file that PyYAML shows."""
    mark = getattr(error, "problem_mark", None)
    if not isinstance(error, yaml.MarkedYAMLError) or mark is None:
        return in_short(error)
    reason = " ".join(text for text in (error.context, error.problem) if text)
    return f"line {mark.line + 1}: {in_short(ValueError(reason))}"


def _check_size(root: yaml.Node) -> None:
    """Refuse a document that would unfold to too much, that is endless or repeats a key."""
    sizes: dict[int, int] = {}
    pending: list[tuple[yaml.Node, bool]] = [(root, False)]
    open_nodes: set[int] = set()
    while pending:
        node, done = pending.pop()
        if id(node) in sizes:
            continue
        children = _children(node)
        if done or not children:
            open_nodes.discard(id(node))
            sizes[id(node)] = total = 1 + sum(sizes[id(child)] for child in children)
            if total > MAX_VALUES:
                raise UnusableYamlError(f"aliases unfold to more than {MAX_VALUES} values")
            continue
        if id(node) in open_nodes:
            raise UnusableYamlError(
                f"line {node.start_mark.line + 1}: an alias that contains itself"
            )
        open_nodes.add(id(node))
        _check_keys(node)
        pending.append((node, True))
        pending += [(child, False) for child in children if id(child) not in sizes]


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [child for pair in node.value for child in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _check_keys(node: yaml.Node) -> None:
    if not isinstance(node, yaml.MappingNode):
        return
    keys = [(k.tag, k.value) for k, _ in node.value if isinstance(k, yaml.ScalarNode)]
    for (_, name), count in Counter(keys).items():
        if count > 1:
            line = node.start_mark.line + 1
            raise UnusableYamlError(f"line {line}: key {name[:60]!r} appears more than once")
