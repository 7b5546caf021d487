"""Finds code without a caller. By name: a name that two things share counts for both."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import msgspec

PLAIN = {"property", "staticmethod", "classmethod", "cache", "contextmanager"}
"""Decorators that leave the calling to others; any other one registers its function."""


class Definition(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A function, class, constant or attribute.

    Attributes:
        where: File and line.
        name: Its own.
        node: Its code.
        text: Its lines.
        outer: The class that it is part of.
    """

    where: str
    name: str
    node: ast.stmt
    text: str
    outer: Definition | None

    def has_all(self, uses: int) -> bool:
        """Whether a number of uses of its name are inside of it."""
        # Counting text takes a fraction of a walk through the tree, and finds too many at most.
        return uses <= self.text.count(self.name) and uses <= _uses(self.node)[self.name]

    def __str__(self) -> str:
        return f"{self.where} {self.name}"


def without_callers(
    sources: Mapping[Path, str], callers: Iterable[str], called_by_others: Iterable[str]
) -> list[Definition]:
    """Names in ``sources`` that neither they nor ``callers`` nor ``called_by_others`` use.

    A use inside of unused code does not count. Fields of classes count as used: they are data.
    """
    trees = {path: ast.parse(text) for path, text in sources.items()}
    every = [*trees.values(), *map(ast.parse, callers)]
    used = Counter[str]()
    for tree in every:
        used.update(_uses(tree))
    known = {*called_by_others, *_exported(trees.values())}
    found = [
        each
        for path, tree in trees.items()
        for each in _definitions(path, sources[path].splitlines(), tree)
        if each.name not in known
    ]
    dead: set[Definition] = set()
    while True:
        new = [
            each
            for each in found
            if each not in dead and each.outer not in dead and each.has_all(used[each.name])
        ]
        if not new:
            return sorted(dead, key=str)
        for each in new:
            if each.outer not in new:
                used.subtract(_uses(each.node))
        dead.update(new)


def _uses(tree: ast.AST) -> Counter[str]:
    uses: Counter[str] = Counter()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Load()) | ast.Attribute(attr=name, ctx=ast.Load()):
                uses[name] += 1
            case ast.MatchClass(kwd_attrs=names):
                uses.update(names)
    return uses


def _exported(trees: Iterable[ast.Module]) -> Iterator[str]:
    """Names in an ``__all__``, and the public members of the classes among them."""
    tops = [node for tree in trees for node in tree.body]
    names = {
        name
        for node in tops
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        for name in ast.literal_eval(node.value)
    }
    yield from names
    for node in tops:
        if isinstance(node, ast.ClassDef) and node.name in names:
            yield from (name for name, _ in _named(node) if not name.startswith("_"))


def _definitions(
    path: Path, lines: list[str], scope: ast.Module | ast.ClassDef, outer: Definition | None = None
) -> Iterator[Definition]:
    for name, node in _named(scope):
        where = f"{path}:{node.lineno}"
        text = "\n".join(lines[node.lineno - 1 : node.end_lineno])
        made = Definition(where=where, name=name, node=node, text=text, outer=outer)
        if not (name.startswith("__") and name.endswith("__")):
            yield made
        if isinstance(node, ast.ClassDef):
            yield from _definitions(path, lines, node, made)


def _named(scope: ast.Module | ast.ClassDef) -> Iterator[tuple[str, ast.stmt]]:
    for node in scope.body:
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                if {ast.unparse(each).split("(")[0] for each in node.decorator_list} <= PLAIN:
                    yield node.name, node
                if isinstance(scope, ast.ClassDef):
                    yield from _attributes(node)
            case ast.Assign(targets=[ast.Name(id=name)]):
                yield name, node
            case ast.AnnAssign(target=ast.Name(id=name)) if isinstance(scope, ast.Module):
                yield name, node


def _attributes(method: ast.stmt) -> Iterator[tuple[str, ast.stmt]]:
    for node in ast.walk(method):
        match node:
            case (
                ast.Assign(targets=[ast.Attribute(value=ast.Name(id="self"), attr=name)])
                | ast.AnnAssign(target=ast.Attribute(value=ast.Name(id="self"), attr=name))
            ):
                yield name, node
