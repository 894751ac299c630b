"""Formats the fit of a recorded motion, in words and as JSON for outside tools."""

from __future__ import annotations

import math
from typing import Any

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify import text as identified
from haptic_wall.controller.experiments.recorded.estimate import Recorded
from haptic_wall.controller.experiments.recorded.friction import MEANING, TERMS

UNITS = {
    **identified.UNITS,
    "torque_constant": "N·m/A",
    "inertia_total": "kg·m²",
    "hanging": "rad",
}
_WORDS = {
    **identified.WORDS,
    "torque_constant": "torque constant",
    "inertia_total": "whole inertia",
    "hanging": "hangs at",
}
_NAMES = {"hanging": "hanging_rad", "torque_constant": "torque_constant_nm_per_a"}


def report(found: Recorded) -> dict[str, Any]:
    """Return the contract's keys, and more on the fit."""
    return {
        **{_NAMES.get(name, name): _report(getattr(found, name)) for name in UNITS},
        "residual_rms_rad": found.residual,
        "rounding_rad": found.step / math.sqrt(12.0),
        "friction_model": found.friction_model,
        "friction": {name: each.report() for name, each in found.friction.items()},
        "models": [
            {
                "name": each.name,
                "meaning": MEANING[each.name],
                "fitted_rms_rad": each.fitted,
                "predicted_rms_rad": each.predicted,
            }
            for each in found.models
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
        each: Estimated | None = getattr(found, name)
        word = _WORDS.get(name, name)
        if each is None:
            if name in identified.UNITS:
                lines.append(f"{word:<17} cannot be determined")
        elif name == "delay":
            lines.append(f"{word:<17} {each.in_ms(2)}")
        else:
            lines.append(f"{word:<17} {each} {unit}".rstrip())
    if found.friction_model is not None:
        lines.append(f"{'friction':<17} {found.friction_model}: {MEANING[found.friction_model]}")
    for name, each in found.friction.items():
        lines.append(f"  {name.replace('_', ' '):<15} {each} {TERMS[name].unit}".rstrip())
    if found.residual is not None:
        parts = f"{len(found.stretches)} part{'s' * (len(found.stretches) > 1)}"
        lines.append(
            f"{'residual':<17} {1e3 * found.residual:.2f} mrad rms, of {found.seconds:.1f} s in"
            f" {parts}"
        )
    for model in found.models:
        if model.predicted is not None:
            lines.append(
                f"  {model.name:<15} leaves {1e3 * model.fitted:.2f} mrad in pieces, predicts"
                f" others to {1e3 * model.predicted:.1f}"
            )
    lines += [f"{'note':<17} {note}" for note in found.notes]
    if plot is not None:
        lines.append(f"{'picture':<17} {plot}")
    return "\n".join(lines)


def _report(estimated: Estimated | None) -> dict[str, float] | None:
    return None if estimated is None else estimated.report()
