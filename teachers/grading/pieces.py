"""The statements of a notebook that a name needs: its definition and what that uses, and not the figures around it."""

from __future__ import annotations

import ast
import symtable
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any


@dataclass
class Statement:
    """A statement at the top of a cell, with the names that it makes, changes, needs at once, and needs when called."""

    node: ast.stmt
    own: bool  # in a cell that the student has written
    makes: set[str]
    changes: set[str]
    needs: set[str]
    later: set[str]


@cache
def statements(source: str, own: bool = False) -> list[Statement]:
    """The statements of a cell; lines of IPython, such as ``%timeit``, are left out."""
    try:
        tree = ast.parse(source)
    except SyntaxError:
        lines = source.splitlines()
        kept = [
            "pass".rjust(len(x) - len(x.lstrip()) + 4) if x.lstrip()[:1] in ("%", "!", "?") else x
            for x in lines
        ]
        tree = ast.parse("\n".join(kept))
    return [_statement(node, own) for node in tree.body]


def _statement(node: ast.stmt, own: bool) -> Statement:
    table = symtable.symtable(ast.unparse(node), "cell", "exec")
    makes = {s.get_name() for s in table.get_symbols() if s.is_assigned() or s.is_imported()}
    needs = {s.get_name() for s in table.get_symbols() if s.is_referenced()}
    inner = {s.get_name() for child in table.get_children() for s in _globals(child)}
    function, inside = (
        isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef),
        isinstance(node, ast.ClassDef),
    )
    plain = isinstance(node, ast.Assign | ast.AnnAssign | ast.Import | ast.ImportFrom) or function or inside
    named = set() if function else {name.id for part in ast.walk(node) for name in _changed(part)}
    changes = named | (set() if plain else makes)  # a loop may leave its names as they were
    later = inner if function or inside else set()
    return Statement(node, own, makes, changes, needs if function else needs | inner, later)


def _globals(table: symtable.SymbolTable) -> list[symtable.Symbol]:
    """What a function, and those in it, take from outside."""
    return [s for s in table.get_symbols() if s.is_global()] + [
        s for child in table.get_children() for s in _globals(child)
    ]


def _changed(part: ast.AST) -> Iterable[ast.Name]:
    """The name whose object a part of a statement may change: ``a[0] = 1``, ``a.b = 1``, ``a.append(1)``."""
    if isinstance(part, ast.Subscript | ast.Attribute) and isinstance(part.ctx, ast.Store):
        inner = part.value
    elif isinstance(part, ast.Expr) and isinstance(getattr(part.value, "func", None), ast.Attribute):
        inner = part.value.func.value  # called for what it does, and not for its answer
    else:
        return
    while isinstance(inner, ast.Subscript | ast.Attribute):
        inner = inner.value
    if isinstance(inner, ast.Name):
        yield inner


def needed(program: list[Statement], names: set[str]) -> list[Statement]:
    """The statements of a program, in their order, without which these names would be others or missing."""
    later: dict[str, set[str]] = {}
    for statement in program:
        for name in statement.makes:
            later[name] = later.get(name, set()) | statement.later
    modules = {n for s in program if isinstance(s.node, ast.Import | ast.ImportFrom) for n in s.makes}
    alive, kept = _with_later(names, later), []
    for statement in reversed(program):
        star = isinstance(statement.node, ast.ImportFrom) and statement.node.names[0].name == "*"
        if not star and not alive & (statement.makes | (statement.changes - modules)):
            continue
        kept.append(statement)
        if not statement.changes & statement.makes:  # an `if` or a loop may leave its names as they were
            alive -= statement.makes
        alive |= _with_later(statement.needs, later)
    return kept[::-1]


def _with_later(names: set[str], later: dict[str, set[str]]) -> set[str]:
    """These names, and all that the functions among them use when they are called."""
    found: set[str] = set()
    ahead = set(names)
    while ahead:
        found |= ahead
        ahead = set().union(*(later.get(name, set()) for name in ahead)) - found
    return found


def run(program: list[Statement], module: ModuleType) -> dict[str, Any]:
    """Run statements one after the other; gives the names of the module."""
    for statement in program:
        code = compile(ast.Module([statement.node], []), "notebook", "exec", dont_inherit=True)
        exec(code, vars(module))
    return vars(module)
