"""Formats the report's figures and facts as text."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from haptic_wall.controller.system.wrapping import wrapped


def figure(value: float) -> str:
    """Format three digits, large numbers in groups of thousands."""
    rounded = float(f"{value:.3g}")  # 999.9 are 1,000
    return f"{rounded:,.0f}" if abs(rounded) >= 1000 else f"{rounded:.3g}"


def stolen(percent: float | None) -> str:
    """Format the host's steal time."""
    if percent is None:
        return "the host's share of the processors' time is not known"
    return f"{percent:.2g} % of the processors' time taken by the host"


def text(report: Mapping[str, Any]) -> str:
    """Format the report of ``haptic-wall bench``."""
    on, load = report["machine"], report["machine"]["load_average"]
    count = "an unknown number of" if on["cores"] is None else on["cores"]
    cores = "1 core" if count == 1 else f"{count} cores"
    installed = ", ".join(
        f"{name} {number}" if number else f"{name} not installed"
        for name, number in report["versions"].items()
    )
    before = "unknown load before" if load is None else f"load {load[0]:.2f} before"
    lines = [f"{on['processor']}, {cores}, {on['system']}, {on['kernel']}"]
    lines += _folded(installed, 0)
    lines.append(f"{before}, {stolen(on['steal_percent'])} in {report['seconds']:.0f} s")
    for name, section in report["sections"].items():
        took = f"{section['seconds']:.0f} s, {stolen(section['steal_percent'])}"
        lines += ["", f"{name.replace('_', ' ')} ({took})"]
        for shows_not, rows in itertools.groupby(section["rows"], lambda row: row["shows_not"]):
            lines += [_line(row) for row in rows]
            lines += _folded(f"does not show {shows_not}", 4)
        for note in section["notes"]:
            lines += _folded(note, 2)
    if report["interrupted"]:
        lines += ["", "interrupted: only the sections above are complete"]
    return "\n".join(lines)


def _line(row: Mapping[str, Any]) -> str:
    value = figure(row["value"])
    value += "" if row["unit"] == "1" else f" {row['unit']}"
    if row["low"] is not None:
        value += f" ({figure(row['low'])} to {figure(row['high'])})"
    return f"  {value}  {row['name']}"


def _folded(text: str, indent: int) -> list[str]:
    space = " " * indent
    return wrapped(text, space, space)
