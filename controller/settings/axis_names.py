"""The names of axes, and paths that begin with one; for processes that load no settings, too."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

MOST_AXES: Final = 16
MOST_NAME: Final = 24
"""Longest name of an axis [letters]"""
NAME: Final = rf"[a-z][a-z0-9_]{{0,{MOST_NAME - 1}}}"
"""Pattern of such a name"""


def split_path(path: str) -> tuple[str, str]:
    """Return the axis of a setting, as ``axes.NAME.`` or empty, and its path in that axis alone."""
    steps = path.split(".", 2)
    return (f"axes.{steps[1]}.", steps[2]) if steps[0] == "axes" and len(steps) > 2 else ("", path)


def of_axis(new: Mapping[str, Any], axis: str) -> dict[str, Any]:
    """Return what a change of a run changes of one axis, by the paths that it has alone."""
    prefix = f"axes.{axis}." if axis else ""
    return {path.removeprefix(prefix): new[path] for path in new if path.startswith(prefix)}
