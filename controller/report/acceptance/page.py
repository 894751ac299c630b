"""Makes the report of an acceptance as one HTML page, and its table as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from haptic_wall.controller.experiments.acceptance import FAILS, HOLDS
from haptic_wall.controller.report.html import filled_in


def page(report: Mapping[str, Any]) -> str:
    """Return the page's text, of the report's data."""
    rows = [
        {
            "name": row["name"],
            "unit": row["unit"],
            "predicted": predicted_text(row),
            "real": figure_text(row["real"]),
            "emulated": figure_text(row["emulated"]),
            "verdict": row["verdict"],
            "note": row["note"],
            "style": {HOLDS: "holds", FAILS: "fails"}.get(row["verdict"], ""),
        }
        for row in report["rows"]
    ]
    return filled_in(__package__, r=report, rows=rows)


def predicted_text(row: Mapping[str, Any]) -> str:
    """Return the bounds of a prediction."""
    if row["low"] is None or row["high"] is None:
        return "-"
    return f"{row['low']:.3g} to {row['high']:.3g}"


def figure_text(found: Mapping[str, Any] | None) -> str:
    """Return a figure with its standard error and its kick."""
    if found is None:
        return "-"
    text = f"{found['value']:.4g}"
    if found["stderr"] is not None:
        text += f" ± {found['stderr']:.2g}"
    if found["kick_rad"] is not None:
        text += f" (kick {found['kick_rad']:.3g} rad)"
    return text
