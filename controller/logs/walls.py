"""The walls of a logged run: that of its start, and that of each change while it ran."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from haptic_wall.controller.errors import ConfigError, LogFormatError
from haptic_wall.controller.settings.changes import with_changes
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.fields import sections
from haptic_wall.controller.settings.load import loaded
from haptic_wall.controller.system.printable import in_line

_OF_LAWS = "wall.law:", "wall.options:", "wall.parts:"
APPLIED = "applied"
"""Outcome of a change that was made"""


@dataclass(frozen=True, slots=True)
class Walls:
    """The configurations of a run, one after the other."""

    since: tuple[int, ...]
    """Sequence number of the first row of each; the first is 0"""
    configs: tuple[Config, ...]

    def at(self, seq: int) -> Config:
        """Return the configuration at a row."""
        return self.configs[bisect_right(self.since, seq) - 1]


def walls_of(metadata: Mapping[str, Any], changes: Iterable[Mapping[str, Any]]) -> Walls:
    """Return the configurations of a logged run.

    Args:
        metadata: With the configuration of the start.
        changes: Requests to change the wall, as the log has them.

    Raises:
        LogFormatError: A configuration is not one that this program can use here.
    """
    if "config" not in metadata:
        raise LogFormatError(
            "the log has no configuration",
            advice="export its rows with `haptic-wall log LOG --csv FILE`",
        )
    since, configs = [0], [_config(metadata["config"])]
    for change in made(changes):
        if isinstance(change["changed"], dict):
            since.append(change["row"])
            configs.append(_config(with_changes(configs[-1], change["changed"])))
    return Walls(tuple(since), tuple(configs))


def made(changes: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the changes that were made, in the order of their rows, each once."""
    found: dict[int, Mapping[str, Any]] = {}
    for change in changes:
        if change["outcome"] == APPLIED and change["row"] is not None:
            found[change["row"]] = change
    return [found[row] for row in sorted(found)]


def _config(data: object) -> Config:
    problems: Sequence[str] = ("",)
    try:
        if isinstance(data, dict):
            known = {
                name: {key: data[name][key] for key in section.model_fields if key in data[name]}
                for name, section in sections().items()
                if isinstance(data.get(name), dict)
            }  # a setting that went does not count
            return loaded(known, "of the log")
    except ConfigError as error:
        problems = error.problems
    law = next((each for each in problems if each.startswith(_OF_LAWS)), None)
    if law is not None:
        raise LogFormatError(
            f"the run's law is not available here: {in_line(law, 1000)}",
            advice="install its distribution",
        )
    raise LogFormatError(
        f"this program does not know the log's configuration ({len(problems)} differences)",
        advice="use the haptic-wall that wrote the log",
    )
