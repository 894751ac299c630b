"""Formats the fit of a recorded motion, in words and as JSON for outside tools."""

from __future__ import annotations

import math
from typing import Any

from haptic_wall.controller.experiments.identify import text as identified
from haptic_wall.controller.experiments.recorded.estimate import Recorded
from haptic_wall.controller.experiments.recorded.friction import MEANING, TERMS

UNITS = {
    **identified.UNITS,
    "torque_constant": "N·m/A",
    "inertia_total": "kg·m²",
    "hanging": "rad",
}
_WORDS = {**identified.WORDS, "inertia_total": "whole inertia", "hanging": "hangs at"}
_NAMES = {"hanging": "hanging_rad", "torque_constant": "torque_constant_nm_per_a"}


def report(found: Recorded) -> dict[str, Any]:
    """Return the contract's keys, and more on the fit."""
    known = {name: each.report() for name, each in found.known.items()}
    return {
        **{_NAMES.get(name, name): known.get(name) for name in UNITS},
        "residual_rms_rad": found.residual,
        "rounding_rad": found.step / math.sqrt(12.0),
        "friction_model": found.chosen,
        "friction": {name: known[name] for name in found.friction},
        "models": [
            {"name": name, "meaning": MEANING[name], "fitted_rms_rad": each.residual}
            for name, each in found.models.items()
        ],
        "parts": len(found.stretches),
        "fitted_s": found.seconds,
        "notes": list(found.notes),
    }


def text(found: Recorded, plot: str | None) -> str:
    """Return the answer for people.

    Args:
        found: The estimates from the record.
        plot: Path of the picture; None: none was drawn.
    """
    lines = []
    for name, unit in UNITS.items():
        each = found.known.get(name)
        if each is not None:
            value = each.in_ms(2) if name == "delay" else f"{each} {unit}".rstrip()
        elif name in identified.UNITS:
            value = "cannot be determined"
        else:
            continue
        lines.append((_WORDS.get(name, name.replace("_", " ")), value))
    if found.chosen is not None and found.residual is not None:
        lines.append(("friction", f"{found.chosen}: {MEANING[found.chosen]}"))
        for name, each in found.friction.items():
            lines.append((f"  {name}", f"{each} {TERMS[name].unit}".rstrip()))
        parts = f"{len(found.stretches)} part{'s' * (len(found.stretches) > 1)}"
        left = f"{1e3 * found.residual:.2f} mrad rms, of {found.seconds:.1f} s in {parts}"
        lines.append(("residual", left))
        if len(found.models) > 1:
            for name, shot in found.models.items():
                left = f"leaves {1e3 * shot.residual:.2f} mrad in pieces of a second"
                lines.append((f"  {name}", left))
    lines += [("note", note) for note in found.notes]
    if plot is not None:
        lines.append(("picture", plot))
    return "\n".join(f"{word:<17} {value}" for word, value in lines)
