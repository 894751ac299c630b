"""Finds what nothing uses: definitions that no command, public function, plugin, page or script
reaches.

Names are followed, not values. A name or an import leads to the definition it stands for; an
attribute leads to every method of that name whose class is reached. So what is found is not used;
what is not found may still not be.
"""

from __future__ import annotations

import ast
import builtins
import re
import tomllib
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import haptic_wall

ROOT = Path(__file__).parents[1]
PACKAGE = "haptic_wall"
THEORY = f"{PACKAGE}.controller.theory"
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
TYPED = re.compile(r"^(?:>>>|\.\.\.) ?(.*)$", re.MULTILINE)
CODE = re.compile(r"`([^`\n]+)`")
WORD = re.compile(r"[A-Za-z_]\w*")
DATA = {"Generic", "NamedTuple", "Protocol", "object"}
"""Bases that call no method of a class by its name"""
ACCESS = {"classmethod", "contextmanager", "property", "setter", "staticmethod"}
"""Decorators of methods that register nothing"""

Node = tuple[str, str]
"""Module, and a name in it: ``function``, ``Class`` or ``Class.method``; ``""``: all else"""
FunctionDef = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Module:
    """Definitions and imports of one file."""

    name: str
    bodies: dict[str, list[ast.AST]] = field(default_factory=lambda: defaultdict(list))
    """The code of each name"""
    imported: dict[str, Node] = field(default_factory=dict)
    """The object that a local name stands for"""
    foreign: set[str] = field(default_factory=set)
    """Classes with a base from outside, which may call any of their methods"""


@cache
def package_modules() -> dict[str, Module]:
    """The modules of the package, by name."""
    found = {}
    for part in ("controller", "hw"):
        for path in sorted((ROOT / part).rglob("*.py")):
            steps = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join((PACKAGE, *steps)).removesuffix(".__init__")
            is_package = path.name == "__init__.py"
            found[name] = parsed(name, path.read_text(encoding="utf-8"), is_package)
    return found


@cache
def parsed(name: str, text: str, is_package: bool = False) -> Module:
    """A module from its text."""
    module = Module(name)
    tree = ast.parse(text)
    home = name if is_package else name.rpartition(".")[0]
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                module.imported[alias.asname or alias.name] = (alias.name, "")
        elif isinstance(node, ast.ImportFrom):
            above = home.split(".")[: len(home.split(".")) - node.level + 1]
            source = ".".join(filter(None, [*(above if node.level else []), node.module]))
            for alias in node.names:
                module.imported[alias.asname or alias.name] = (source, alias.name)
    for statement in tree.body:
        _define(module, statement)
    return module


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield every statement, wherever it stands; expressions, most of a tree, are not looked at."""
    waiting: deque[ast.AST] = deque([tree])
    while waiting:
        node = waiting.popleft()
        yield node
        for name in ("body", "handlers", "cases", "orelse", "finalbody"):
            waiting.extend(getattr(node, name, ()))


def _define(module: Module, statement: ast.stmt) -> None:
    match statement:
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            module.bodies[statement.name].append(statement)
            if statement.decorator_list:  # it registers the function, or may
                module.bodies[""].append(ast.Name(statement.name))
        case ast.ClassDef():
            _define_class(module, statement)
        case ast.Assign() | ast.AnnAssign():
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            names = [
                n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)
            ]
            for name in names:
                module.bodies[name].append(statement)
            if not names or isinstance(statement.value, ast.Call):
                module.bodies[""].append(statement.value or statement)
        case ast.Import() | ast.ImportFrom():
            pass
        case ast.If() | ast.Try():
            for inner in ast.iter_child_nodes(statement):
                if isinstance(inner, ast.stmt):
                    _define(module, inner)
                else:
                    module.bodies[""].append(inner)
        case _:
            module.bodies[""].append(statement)


def _define_class(module: Module, made: ast.ClassDef) -> None:
    for base in made.bases:
        name = base.value if isinstance(base, ast.Subscript) else base
        text = ast.unparse(name)
        source = module.imported.get(text.partition(".")[0], ("", ""))[0]
        local = text in module.bodies
        if not local and not source.startswith(PACKAGE) and text.rpartition(".")[2] not in DATA:
            module.foreign.add(made.name)
    for inner in made.body:
        if isinstance(inner, FunctionDef) and ACCESS.issuperset(map(_head, inner.decorator_list)):
            module.bodies[f"{made.name}.{inner.name}"].append(inner)
        else:
            module.bodies[made.name].append(inner)
    module.bodies[made.name] += [*made.bases, *made.keywords, *made.decorator_list]


def _head(decorator: ast.expr) -> str:
    return ast.unparse(decorator).rpartition(".")[2]


@dataclass
class Search:
    """Follows names from the entry points."""

    modules: dict[str, Module]
    reached: set[Node] = field(default_factory=set)
    attributes: set[str] = field(default_factory=lambda: {"main"})
    loaded: set[str] = field(default_factory=set)
    """Modules that are loaded by a name in a text"""
    _waiting: list[Node] = field(default_factory=list)

    def reach(self, node: Node) -> None:
        """Note that a name is used."""
        module, name = node
        for _ in range(9):  # re-exported by how many
            if module not in self.modules:
                return
            if f"{module}.{name}" in self.modules:
                module, name = f"{module}.{name}", ""
            home = self.modules[module]
            if name in home.bodies or not name or name not in home.imported:
                break
            module, name = home.imported[name]
        if (module, name) not in self.reached:
            self.reached.add((module, name))
            self._waiting.append((module, name))
            if name:
                self.reach((module, ""))

    def follow(self) -> None:
        """Until nothing new is found."""
        while self._waiting:
            while self._waiting:
                module, name = self._waiting.pop()
                for body in self.modules[module].bodies.get(name, []):
                    self.read(self.modules[module], body)
            for module, name in self._methods():
                self.reach((module, name))

    def read(self, module: Module, body: ast.AST) -> None:
        """Note every name that some code uses."""
        for node in ast.walk(body):
            match node:
                case ast.Name(id=name):
                    self._name(module, name)
                case ast.Attribute(value=value, attr=attr):
                    self.attributes.add(attr)
                    self._dotted(module, value, attr)
                case ast.Constant(value=str(text)):
                    self._text(module, text)
                case ast.ImportFrom() | ast.Import():
                    for alias in node.names:
                        self._name(module, alias.asname or alias.name)
                case ast.MatchClass(kwd_attrs=names):
                    self.attributes.update(names)

    def _name(self, module: Module, name: str) -> None:
        if name in module.bodies:
            if module.name in self.modules:
                self.reach((module.name, name))
        elif name in module.imported:
            self.reach(module.imported[name])

    def _dotted(self, module: Module, value: ast.expr, attr: str) -> None:
        """A name in a module: ``words.headline``."""
        if not isinstance(value, ast.Name | ast.Attribute):
            return
        text = value.id if isinstance(value, ast.Name) else ast.unparse(value)
        if text in module.imported:
            source, name = module.imported[text]
            self.reach((f"{source}.{name}" if name else source, attr))

    def _text(self, module: Module, text: str) -> None:
        """A module that is loaded, or run as a process, by its name; an annotation in quotes."""
        module_name, _, attribute = text.partition(":")
        if module_name in self.modules:
            self.loaded.add(module_name)
            self.reach((module_name, attribute))
        elif text.isidentifier():
            self._name(module, text)

    def _methods(self) -> Iterator[Node]:
        for module in self.modules.values():
            for name in module.bodies:
                made, dot, method = name.partition(".")
                if dot and (module.name, made) in self.reached:
                    called = method in self.attributes or made in module.foreign
                    if called or method.startswith(("__", "test_")):
                        yield module.name, name
                elif module.name in self.loaded and name in self.attributes:
                    yield module.name, name


def unused(texts: Iterable[str], names: Iterable[Node], words: Iterable[str] = ()) -> list[str]:
    """Definitions that nothing reaches.

    Args:
        texts: Python outside of the package that uses it.
        names: Where else a use begins.
        words: Attributes that are used elsewhere.
    """
    search = Search(package_modules())
    search.attributes.update(words)
    for text in texts:
        module = parsed("", text)
        for bodies in list(module.bodies.values()):
            for body in bodies:
                search.read(module, body)
        for source, name in module.imported.values():
            search.reach((source, name))
    for node in names:
        search.reach(node)
    search.follow()
    return sorted(
        f"{module.name}.{name}"
        for module in search.modules.values()
        for name in module.bodies
        if name and (module.name, name) not in search.reached and not hasattr(builtins, name)
        if not (name.startswith("__") and name.endswith("__"))
    )


def entry_points() -> Iterator[Node]:
    """Where users of the package begin: the command, the plugin, the theory, the public face."""
    plugins = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    for group in plugins.values():
        for target in group.values():
            module, colon, name = target.partition(":")
            yield from [(module, name)] if colon else ((module, name) for name in public(module))
    for path in (ROOT / "controller" / "cli").glob("*.py"):
        yield f"{PACKAGE}.controller.cli.{path.stem}", "command"
    yield f"{PACKAGE}.controller.cli.entry", "main"
    yield from ((THEORY, name) for name in public(THEORY))
    for home in haptic_wall._HOMES.items():
        module, _, inner = home[1].partition(":")
        yield f"{PACKAGE}.{module}", inner or home[0]
    named = {word for page in pages() for code in CODE.findall(page) for word in WORD.findall(code)}
    for path in (ROOT / "controller" / "theory").glob("*.py"):
        module = f"{THEORY}.{path.stem}"
        if path.stem in named:
            yield from ((module, name) for name in public(module))
        text = path.read_text(encoding="utf-8")
        yield from ((module, name) for name in parsed(module, text).bodies if name in named)


def public(module: str) -> list[str]:
    """Names that a module exports."""
    path = ROOT.joinpath(*module.split(".")[1:])
    source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    tree = ast.parse(source.read_text(encoding="utf-8"))
    exported = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    hooks = [
        n.name for n in tree.body if isinstance(n, FunctionDef) and n.name.startswith("pytest_")
    ]
    return [*hooks, *next(exported, [])]


def pages() -> Iterator[str]:
    """The text of every page."""
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        yield path.read_text(encoding="utf-8")


@cache
def outside() -> tuple[str, ...]:
    """Python that uses the package: scripts, examples, and what the pages show."""
    files = [
        path.read_text(encoding="utf-8")
        for folder in ("scripts", "docs/examples")
        for path in sorted((ROOT / folder).rglob("*.py"))
    ]
    blocks = (block for page in pages() for block in PYTHON.findall(page))
    return (*files, *("\n".join(TYPED.findall(block)) or block for block in blocks))


def template_words() -> set[str]:
    """Every word of the templates: they call methods by name."""
    return {
        word
        for path in (ROOT / "controller").rglob("*.j2")
        for word in WORD.findall(path.read_text(encoding="utf-8"))
    }
