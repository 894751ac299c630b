"""Reads YAML as people mean it: ``off`` is a word, ``1e6`` a number, and no key occurs twice.

The library follows YAML 1.1, where ``off`` is false, ``1e6`` a text, ``010`` eight and ``1:30``
ninety. This reader uses the core schema of YAML 1.2 for plain words.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.printable import in_line

_WORDS = (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
)
_MOST_DIGITS = 400
"""More digits than any float has"""


class _Loader(yaml.SafeLoader):
    """Loads plain data only, by the rules above; keys are texts."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:  # noqa: ANN401 - the library's signature
        """Compose as the base class, but refuse aliases: few can stand for billions of values."""
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.constructor.ConstructorError(
                None, None, "found an alias (*name): write the values out", mark
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Construct as the base class, but keep keys as texts: true, 1 and null too."""
        _refuse_twice(node)
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                key.tag = "tag:yaml.org,2002:str"
        return super().construct_mapping(node, deep)


def _whole_number(loader: _Loader, node: yaml.ScalarNode) -> int | float:
    """Read a decimal: a leading zero is no other base; a huge number is a float."""
    text = loader.construct_scalar(node)
    return int(text) if len(text) < _MOST_DIGITS else float(text)


for _name, _pattern, _first in _WORDS:
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_name}", re.compile(f"({_pattern})$"), _first
    )
_Loader.add_constructor("tag:yaml.org,2002:int", _whole_number)


def parse(text: str, source: str, field: str | None = None) -> Any:  # noqa: ANN401 - whatever the text holds
    """Return the data in a YAML text.

    Args:
        text: One YAML document.
        source: Name of the text, for the error message.
        field: The option that ``source`` is the value of; None: it is none's.

    Raises:
        UserError: It is not YAML, a key stands twice, or it has an alias.
    """
    try:
        return yaml.load(text, _Loader)  # a SafeLoader, for plain data
    except RecursionError:
        raise UserError("found sections nested too deeply", field=field, given=source) from None
    # the last two are errors of the library, over !!bool abc and the like
    except (yaml.YAMLError, ValueError, LookupError, AttributeError) as error:
        raise UserError(_reason(error), field=field, given=source) from None


def _refuse_twice(node: yaml.MappingNode) -> None:
    """Refuse a duplicate key, instead of the last one winning."""
    seen: dict[str, int] = {}
    for key, _ in node.value:
        line = key.start_mark.line + 1
        if isinstance(key, yaml.ScalarNode) and key.value in seen:
            twice = f"stands twice, in lines {seen[key.value]} and {line}: keep one"
            text = f"the key {in_line(key.value)} {twice}"
            raise yaml.constructor.ConstructorError(None, None, text, key.start_mark)
        seen[str(key.value)] = line


def _reason(error: Exception) -> str:
    """Join the library's lines into one."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        problem = (error.problem or "").removeprefix("but ")
        return f"line {mark.line + 1}, column {mark.column + 1}: {problem}"
    return f"not readable as YAML: {error}".splitlines()[0]
