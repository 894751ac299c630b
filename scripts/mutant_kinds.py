"""Small defects that can be put into a module: their places, and the module with one of them.

A mutant changes one place: a comparison, a number, a sign, an operator, a statement. It is named by
the role of its module, the function it is in, its kind, and how many of that kind come before it in
that function. None of these changes when the module is moved or renamed.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

ROLES = {
    "guard": ("controller/guard/*.py",),
    "detector": ("controller/detector/*.py",),
    "tick": (
        "controller/runtime/axis.py",
        "controller/runtime/cycle.py",
        "controller/runtime/gains.py",
        "controller/runtime/motion_watch.py",
        "controller/runtime/loop.py",
    ),
    "codec": ("hw/dynamixel/codec/*.py",),
    "exchange": ("hw/dynamixel/exchange.py", "hw/dynamixel/station.py"),
    "safety": (
        "controller/runtime/safety.py",
        "controller/runtime/overspeed.py",
        "controller/runtime/missed.py",
    ),
}
"""Files of each role, as patterns from the folder of the project: where modules move, edit this"""
_BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_OPPOSITE = {
    **{ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt},
    **{ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is},
    **{ast.In: ast.NotIn, ast.NotIn: ast.In},
}
_SIGN = {ast.Add: ast.Sub, ast.Sub: ast.Add}
_FACTOR = {ast.Mult: ast.Div, ast.Div: ast.Mult}
_EXTREME = {"min": "max", "max": "min"}
Edit = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Mutant:
    """One small defect."""

    id: str
    """role:function:kind:ordinal"""
    role: str
    kind: str
    path: str
    """Path of the module, from the folder of the project"""
    line: int
    statement: int
    """Place of its statement in the module; -1: it is outside of functions"""
    number: int
    """Place among the mutants of its module"""
    before: str
    """The mutated part, as it was"""
    within: str
    """First line of its statement"""


@dataclass(slots=True)
class _Place:
    """A place where one mutant may be made; ``edit`` makes it in the tree."""

    kind: str
    function: str
    node: ast.AST
    statement: ast.stmt
    edit: Edit


def places(tree: ast.Module) -> Iterator[_Place]:
    """All places of a module where a mutant may be made, in a fixed order."""
    yield from _in_block(tree.body, "<module>", inside=False)


def _in_block(body: list[ast.stmt], function: str, *, inside: bool) -> Iterator[_Place]:
    for at, statement in enumerate(body):
        if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            name = statement.name if function == "<module>" else f"{function}.{statement.name}"
            is_class = isinstance(statement, ast.ClassDef)
            yield from _in_block(statement.body, name, inside=not is_class)
            continue
        if _is_text(statement) or isinstance(statement, (ast.Import, ast.ImportFrom, ast.Raise)):
            continue
        if _names(statement) & {"__slots__", "__all__", "TYPE_CHECKING"}:
            continue
        if inside:
            yield from _of_statement(body, at, function)
        for part in _expressions(statement):
            yield from _of_expression(part, function, statement)
        for block in _blocks(statement):
            yield from _in_block(block, function, inside=inside)


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _names(statement: ast.stmt) -> set[str]:
    if isinstance(statement, ast.Assign):
        return {part.id for part in statement.targets if isinstance(part, ast.Name)}
    if isinstance(statement, ast.If) and isinstance(statement.test, ast.Name):
        return {statement.test.id}
    return set()


def _blocks(statement: ast.stmt) -> Iterator[list[ast.stmt]]:
    """Lists of statements inside a statement."""
    for name in ("body", "orelse", "finalbody"):
        if block := getattr(statement, name, None):
            yield block
    for name in ("handlers", "cases"):
        for part in getattr(statement, name, ()):
            yield part.body


def _expressions(statement: ast.stmt) -> Iterator[ast.expr]:
    """Expressions of a statement itself, without annotations and the statements inside it."""
    for name, value in ast.iter_fields(statement):
        if name in ("annotation", "body", "orelse", "finalbody", "handlers", "cases"):
            continue
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, ast.expr):
                yield part
            elif isinstance(part, ast.withitem):
                yield part.context_expr


def _of_statement(body: list[ast.stmt], at: int, function: str) -> Iterator[_Place]:
    statement = body[at]

    def replace(new: ast.stmt) -> Edit:
        return lambda: body.__setitem__(at, ast.copy_location(new, statement))

    call = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
    stored = isinstance(statement, ast.AugAssign) or (
        isinstance(statement, ast.Assign)
        and all(isinstance(part, (ast.Attribute, ast.Subscript)) for part in statement.targets)
    )
    if call or stored:
        yield _Place("drop", function, statement, statement, replace(ast.Pass()))
    if at and not isinstance(statement, (ast.Return, ast.Pass)):
        yield _Place("return", function, statement, statement, replace(ast.Return(value=None)))
    if isinstance(statement, ast.AugAssign):
        for kind, table in (("sign", _SIGN), ("factor", _FACTOR)):
            if other := table.get(type(statement.op)):
                edit = _setting(statement, "op", other())
                yield _Place(kind, function, statement, statement, edit)


def _setting(node: ast.AST, name: str, value: object) -> Edit:
    return lambda: setattr(node, name, value)


def _of_expression(part: ast.expr, function: str, statement: ast.stmt) -> Iterator[_Place]:
    for node in ast.walk(part):
        for kind, edit in _edits(node):
            yield _Place(kind, function, node, statement, edit)


def _edits(node: ast.AST) -> Iterator[tuple[str, Edit]]:  # noqa: PLR0912 - one case a kind
    """Kinds of mutants that an expression may become, and what makes them."""
    match node:
        case ast.Compare(ops=ops):
            for at, op in enumerate(ops):
                for kind, table in (("boundary", _BOUNDARY), ("comparison", _OPPOSITE)):
                    if other := table.get(type(op)):
                        yield kind, _putting(ops, at, other())
        case ast.BoolOp(op=ast.And()):
            yield "and-or", _setting(node, "op", ast.Or())
        case ast.BoolOp():
            yield "and-or", _setting(node, "op", ast.And())
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert() as op):
            kind = "not" if isinstance(op, ast.Not) else "minus"
            yield kind, _setting(node, "op", ast.UAdd() if kind == "minus" else _Twice())
        case ast.BinOp(op=op):
            for kind, swaps in (("sign", _SIGN), ("factor", _FACTOR)):
                if swapped := swaps.get(type(op)):
                    yield kind, _setting(node, "op", swapped())
        case ast.Constant(value=bool(value)):
            yield "truth", _setting(node, "value", not value)
        case ast.Constant(value=int(value)):
            yield "one-more", _setting(node, "value", value + 1)
            yield "one-less", _setting(node, "value", value - 1)
        case ast.Constant(value=float(value)):
            yield "number", _setting(node, "value", 2.0 * value if value else 1.0)
        case ast.Call(func=ast.Name(id="min" | "max" as name)):
            yield "extreme", _setting(node.func, "id", _EXTREME[name])
        case _:
            pass


class _Twice(ast.Not):
    """Marks a ``not`` that is to be dropped."""


def _putting(things: list[ast.cmpop], at: int, new: ast.cmpop) -> Edit:
    return lambda: things.__setitem__(at, new)


class _DropNot(ast.NodeTransformer):
    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        self.generic_visit(node)
        return node.operand if isinstance(node.op, _Twice) else node


def mutants_of(role: str, path: str, source: str) -> list[Mutant]:
    """All mutants of a module."""
    tree = ast.parse(source)
    numbers = statement_numbers(tree)
    lines = source.splitlines()
    counts: Counter[tuple[str, str]] = Counter()
    found = []
    for at, place in enumerate(places(tree)):
        counts[place.function, place.kind] += 1
        line = getattr(place.node, "lineno", place.statement.lineno)
        found.append(
            Mutant(
                f"{role}:{place.function}:{place.kind}:{counts[place.function, place.kind]}",
                role,
                place.kind,
                path,
                line,
                numbers.get(id(place.statement), -1),
                at,
                ast.unparse(place.node).splitlines()[0],
                lines[place.statement.lineno - 1].strip(),
            )
        )
    return found


def mutated(source: str, at: int) -> tuple[str, str]:
    """The module with one mutant in it, and the line that is changed.

    Args:
        source: Text of the module.
        at: Place in ``mutants_of``.
    """
    tree = ast.parse(source)
    for number, place in enumerate(places(tree)):
        if number == at:
            place.edit()
            break
    else:
        raise IndexError(at)
    changed = _DropNot().visit(tree)
    text = ast.unparse(ast.fix_missing_locations(changed)) + "\n"
    lines = zip_longest(ast.unparse(ast.parse(source)).splitlines(), text.splitlines())
    return text, next((new or "" for old, new in lines if old != new), "").strip()


def statement_numbers(tree: ast.Module) -> dict[int, int]:
    """The number of each statement inside of functions, by the identity of its node."""
    numbers: dict[int, int] = {}
    for block in _function_blocks(tree):
        for statement in block:
            numbers.setdefault(id(statement), len(numbers))
    return numbers


def _function_blocks(tree: ast.AST) -> Iterator[list[ast.stmt]]:
    """Lists of statements that run inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield from _nested(node.body)


def _nested(block: list[ast.stmt]) -> Iterator[list[ast.stmt]]:
    yield block
    for statement in block:
        if not isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            for inner in _blocks(statement):
                yield from _nested(inner)


def watched(path: str, source: str) -> str:
    """The module, telling ``builtins.mutant_hits`` (a set's add) which statements run."""
    tree = ast.parse(source)
    numbers = statement_numbers(tree)
    for block in list(_function_blocks(tree)):
        told: list[ast.stmt] = []
        for statement in block:
            if id(statement) in numbers and not _is_text(statement):
                told.append(_telling(f"{path}#{numbers[id(statement)]}", statement))
            told.append(statement)
        block[:] = told
    head = ast.parse(
        "import builtins as _builtins\n"
        "_mutant_hit = getattr(_builtins, 'mutant_hits', lambda _place: None)"
    )
    at = 0
    while at < len(tree.body) and (_is_text(tree.body[at]) or _is_future(tree.body[at])):
        at += 1
    tree.body[at:at] = head.body
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _is_future(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.ImportFrom) and statement.module == "__future__"


def _telling(place: str, statement: ast.stmt) -> ast.stmt:
    call = ast.Call(ast.Name("_mutant_hit", ast.Load()), [ast.Constant(place)], [])
    return ast.copy_location(ast.Expr(call), statement)


def modules_of(root: Path, role: str) -> list[Path]:
    """Files of a role, as they are in a tree."""
    return sorted(path for pattern in ROLES[role] for path in root.glob(pattern))


def all_mutants(root: Path) -> list[Mutant]:
    """The mutants of all roles in a tree; of those with the same id the later ones get a number."""
    found: list[Mutant] = []
    seen: Counter[str] = Counter()
    for role in ROLES:
        for path in modules_of(root, role):
            source = path.read_text("utf-8")
            for one in mutants_of(role, str(path.relative_to(root)), source):
                seen[one.id] += 1
                more = f"~{seen[one.id]}" if seen[one.id] > 1 else ""
                found.append(replace(one, id=one.id + more))
    return found
