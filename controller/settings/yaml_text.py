"""YAML as people mean it: ``off`` is a word, ``1e6`` a number, and no key stands twice.

The library's own reading follows YAML 1.1, where ``off`` is false, ``1e6`` a text, ``010`` eight
and ``1:30`` ninety. Here plain words are read by the core schema of YAML 1.2.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

from controller.errors import UserError

_WORDS = (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
    ("merge", r"<<", ["<"]),
)


class _Loader(yaml.SafeLoader):
    """Plain data only, with the words above; keys are texts, and none stands twice."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """As the base class, but a duplicate key is an error instead of the last one winning."""
        seen: dict[str, int] = {}
        for key, _ in node.value:
            line = key.start_mark.line + 1
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None,
                    None,
                    f"the key {key.value} stands twice, in lines {seen[key.value]} and {line}: "
                    "keep one",
                    key.start_mark,
                )
            seen[str(key.value)] = line
        self.flatten_mapping(node)  # what << brings in is there by its own keys
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):  # a name is a text: true, 1 and null too
                key.tag = "tag:yaml.org,2002:str"
        return super().construct_mapping(node, deep)


def _whole_number(loader: _Loader, node: yaml.ScalarNode) -> int:
    """Decimal, always: a leading zero is no other base."""
    return int(loader.construct_scalar(node))


for _name, _pattern, _first in _WORDS:
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_name}", re.compile(f"({_pattern})$"), _first
    )
_Loader.add_constructor("tag:yaml.org,2002:int", _whole_number)


def parse(text: str, source: str) -> Any:  # noqa: ANN401 - whatever the text holds
    """The data in a YAML text.

    Args:
        text: One YAML document.
        source: What it is, for the error message.

    Raises:
        UserError: It is not YAML, or a key stands twice.
    """
    try:
        return yaml.load(text, _Loader)  # a SafeLoader: plain data only
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UserError(f"{source}: {_reason(error)}") from None
    except (LookupError, AttributeError):  # the library's, over !!bool abc and its like
        raise UserError(
            f"{source}: found a tag (!!...) with a value that is none of its kind; leave the tag"
            " out"
        ) from None


def _reason(error: Exception) -> str:
    """One line from the library's several."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"line {mark.line + 1}, column {mark.column + 1}: {error.problem}"
    return f"not readable as YAML: {error}".splitlines()[0]
