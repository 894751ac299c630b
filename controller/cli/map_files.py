"""Writes a map's table, report and picture; points are made one by one, so that few are in memory.

A map of a million points would take gigabytes as Python objects and as one text.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.options import as_json, writing
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.maps.maps import CriticalMap

_COLUMNS = (
    *("virtual_damping", "delay_steps", "delay_s", "kick_rad"),
    *("simulated", "outcome", "exact", "linear", "one_sided"),
)
_NOT_MAPPED = (
    "chain",
    *("torque_constant", "current_bandwidth", "current_period", "dead_band", "back_emf"),
    *("current_droop", "no_load_speed", "current_filter", "current_offset", "supply", "ambient"),
    *("position", "hand", "hand_origin", "hand_direction"),
)
"""Truths of a servo that a report does not name"""
FILES = ("map.csv", "map.json", "map.png")
_NO_POINTS = '\n  "points": []'
"""The report's text without its points; a JSON text has no such line break in a string"""
_POINT = ",\n".join(f'      "{name}": {{}}' for name in _COLUMNS)
_TOGETHER = 256
"""Virtual dampings whose points make one part of a text"""


def report_of(found: CriticalMap, name: str) -> dict[str, Any]:
    """Return the report of a map called ``name``, without its points."""
    return {
        **RESULT_MARK,
        "name": name,
        "side": "one" if found.setting.one_sided else "both",
        "period_s": found.setting.period,
        "velocity_samples": found.setting.velocity_samples,
        "servo": {k: v for k, v in asdict(found.setting.servo).items() if k not in _NOT_MAPPED},
        "complete": found.complete,
        "points": [],
    }


def json_parts(found: CriticalMap, report: Mapping[str, Any]) -> Iterator[str]:
    """Yield, in parts, what ``as_json`` would return for the report with its points.

    Args:
        found: The map.
        report: From ``report_of``; more may be added.
    """
    encode = json.JSONEncoder(allow_nan=False).encode
    head, tail = as_json(report).split(_NO_POINTS)
    yield f'{head}\n  "points": ['
    before = "\n"
    for points in _points(found):
        texts = []
        for point in points:
            plain = [_finite(value) for value in point]
            lines = _POINT.format(*encode(plain)[1:-1].split(", "))
            texts.append(f"    {{\n{lines}\n    }}")
        yield before + ",\n".join(texts)
        before = ",\n"
    yield f"\n  ]{tail}"


def write_csv(found: CriticalMap, stream: TextIO) -> None:
    """Write the table of a map's points."""
    writer = csv.writer(stream)
    writer.writerow(_COLUMNS)
    for points in _points(found):
        writer.writerows(points)


def write_map(found: CriticalMap, report: Mapping[str, Any], out: Path) -> list[Path]:
    """Write all files of a map, or none; return their paths.

    Args:
        found: The map.
        report: From ``report_of``.
        out: The folder.

    Raises:
        UserError: A file cannot be written.
    """
    from haptic_wall.controller.report.maps import plot_map

    def csv_table(path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as stream:
            write_csv(found, stream)

    def json_text(path: Path) -> None:
        with path.open("w", encoding="utf-8") as stream:
            stream.writelines(json_parts(found, report))
            stream.write("\n")

    *files, picture = (out / name for name in FILES)
    with writing("--out", out), ExitStack() as all_or_none:
        for file, write in zip(files, (csv_table, json_text), strict=True):
            write(all_or_none.enter_context(whole(file)))
    draw = partial(plot_map, found, report["name"])
    seen = drawn_or_noted("--out", picture, draw)
    return [*files, *([seen] if seen else [])]


def _points(found: CriticalMap) -> Iterator[list[tuple[Any, ...]]]:
    """Yield the values of ``_COLUMNS`` for neighbouring points."""
    kicks = found.kick.tolist()
    for i, (steps, delay) in enumerate(
        zip(found.delay_steps.tolist(), found.delay.tolist(), strict=True)
    ):
        for first in range(0, found.virtual_damping.size, _TOGETHER):
            part = slice(first, first + _TOGETHER)
            rows = zip(
                found.virtual_damping[part].tolist(),
                found.stiffness[i, part].tolist(),
                found.exact[i, part].tolist(),
                found.linear[i, part].tolist(),
                found.one_sided[i, part].tolist(),
                strict=True,
            )
            yield [
                (damping, steps, delay, kick, _finite(value), _outcome(value), *limits)
                for damping, simulated, *limits in rows
                for kick, value in zip(kicks, simulated, strict=True)
            ]


def _finite(value: Any) -> Any:  # noqa: ANN401 - any cell
    """Return a value as JSON knows it."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _outcome(simulated: float) -> str:
    """Describe the result of the search."""
    if math.isnan(simulated):
        return "not computed"
    if math.isinf(simulated):
        return "never grows"
    return "grows above" if simulated > 0.0 else "always grows"
