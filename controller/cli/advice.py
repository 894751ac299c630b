"""Suggests an option or a setting in place of an unknown option."""

from __future__ import annotations

from collections.abc import Sequence

import click


def for_option(error: click.NoSuchOption, arguments: Sequence[str]) -> str:
    """Return a suggestion: a similar option, or ``--set`` with a similar path; empty if none.

    Args:
        error: The unknown option, its command, and similar names.
        arguments: Arguments of the command line, with the option's value.
    """
    name = error.option_name
    paths = _paths(error.ctx, name.lstrip("-").replace("-", "_")) if name.startswith("--") else []
    if paths:
        value = _value(name, arguments)
        return "give " + " or ".join(f"`--set {path}={value}`" for path in paths)
    near = sorted(error.possibilities or [])
    return f"did you mean {' or '.join(near)}?" if near else ""


def _paths(context: click.Context | None, name: str) -> list[str]:
    """Return the paths for ``--set`` of a command that end in a name, or equal it."""
    if context is None:
        return []
    sets = [each for each in context.command.params if each.name == "sets"]
    if not sets:
        return []
    known = [item.value.rstrip("=") for item in sets[0].shell_complete(context, "")]
    return [path for path in known if name in (path, path.partition(".")[2])]


def _value(name: str, arguments: Sequence[str]) -> str:
    """Return the value of an option; ``VALUE`` if it had none."""
    for here, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if here.startswith(f"{name}="):
            return here.partition("=")[2]
        if here == name and following and not following.startswith("--"):
            return following
    return "VALUE"
