"""Formats the report's figures and facts as text."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from haptic_wall.controller.system.wrapping import wrapped


def figure(value: float | None) -> str:
    """Format three digits, large numbers in groups of thousands, a dash for unknown values."""
    if value is None:
        return "–"
    rounded = float(f"{value:.3g}")  # 999.9 are 1,000
    return f"{rounded:,.0f}" if abs(rounded) >= 1000 else f"{rounded:.3g}"


def quartiles(row: Mapping[str, Any]) -> str:
    """Format the quartiles of a row's rounds, if it has them."""
    if row["low"] is None:
        return ""
    return f"{figure(row['low'])} to {figure(row['high'])}"


def unit(row: Mapping[str, Any]) -> str:
    """Format a row's unit; empty for a ratio."""
    return "" if row["unit"] == "1" else str(row["unit"])


def grouped(
    rows: Iterable[Mapping[str, Any]],
) -> Iterator[tuple[str, list[Mapping[str, Any]]]]:
    """Yield limitations, each with the consecutive rows that share it."""
    for shows_not, each in itertools.groupby(rows, lambda row: str(row["shows_not"])):
        yield shows_not, list(each)


def title(name: str) -> str:
    """Return a section's name for people."""
    return name.replace("_", " ")


def installed(report: Mapping[str, Any]) -> str:
    """Format every version in one line."""
    return ", ".join(
        f"{name} {number}" if number else f"{name} not installed"
        for name, number in report["versions"].items()
    )


def hardware(report: Mapping[str, Any]) -> str:
    """Format processor, cores and kernel in one line."""
    on = report["machine"]
    count = "an unknown number of" if on["cores"] is None else on["cores"]
    cores = "1 core" if count == 1 else f"{count} cores"
    return f"{on['processor']}, {cores}, {on['system']}, {on['kernel']}"


def meanwhile(report: Mapping[str, Any]) -> str:
    """Format load and steal time of the machine during the run."""
    on = report["machine"]
    load = on["load_average"]
    before = "unknown load before" if load is None else f"load {load[0]:.2f} before"
    return f"{before}, {stolen(on['steal_percent'])} in {report['seconds']:.0f} s"


def stolen(percent: float | None) -> str:
    """Format the host's steal time."""
    if percent is None:
        return "the host's share of the processors' time is not known"
    return f"{percent:.2g} % of the processors' time taken by the host"


def text(report: Mapping[str, Any]) -> str:
    """Format the report of ``haptic-wall bench``."""
    lines = [hardware(report)]
    lines += _folded(installed(report), 0)
    lines.append(meanwhile(report))
    for name, section in report["sections"].items():
        took = f"{section['seconds']:.0f} s, {stolen(section['steal_percent'])}"
        lines += ["", f"{title(name)} ({took})"]
        for shows_not, rows in grouped(section["rows"]):
            lines += [_line(row) for row in rows]
            lines += _folded(f"does not show {shows_not}", 4)
        for note in section["notes"]:
            lines += _folded(note, 2)
    if report["interrupted"]:
        lines += ["", "interrupted: only the sections above are complete"]
    return "\n".join(lines)


def _line(row: Mapping[str, Any]) -> str:
    spread = quartiles(row)
    value = " ".join(part for part in (figure(row["value"]), unit(row)) if part)
    return f"  {value}{f' ({spread})' if spread else ''}  {row['name']}"


def _folded(text: str, indent: int) -> list[str]:
    space = " " * indent
    return wrapped(text, space, space)
