"""Formats the report's figures and facts as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from haptic_wall.controller.system.wrapping import wrapped


def text(report: Mapping[str, Any]) -> str:
    """Format the report of ``haptic-wall bench``."""
    on = report["machine"]
    versions = ", ".join(
        f"{name} {number}" if number else f"{name} not installed"
        for name, number in report["versions"].items()
    )
    lines = [f"{on['processor']}, {on['cores']} cores, {on['system']}, {on['kernel']}"]
    lines += wrapped(versions)
    for name, section in report["sections"].items():
        lines += ["", f"{name.replace('_', ' ')} ({section['seconds']:.0f} s)"]
        lines += [_line(row) for row in section["rows"]]
        for note in section["notes"]:
            lines += wrapped(note, "  ", "  ")
    if report["interrupted"]:
        lines += ["", "interrupted: only the sections above are complete"]
    return "\n".join(lines)


def _line(row: Mapping[str, Any]) -> str:
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    spread = ""
    if row["low"] is not None:
        spread = f" ({_figure(row['low'])} to {_figure(row['high'])})"
    return f"  {_figure(row['value'])}{unit}{spread}  {row['name']}"


def _figure(value: float) -> str:
    """Format three digits, large numbers in groups of thousands."""
    rounded = float(f"{value:.3g}")  # 999.9 are 1,000
    return f"{rounded:,.0f}" if abs(rounded) >= 1000 else f"{rounded:.3g}"
