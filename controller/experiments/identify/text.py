"""Formats an identification in words and as JSON for outside tools."""

from __future__ import annotations

from typing import Any

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.identification import Identified
from haptic_wall.controller.experiments.identify.vibration import (
    vibration_lines,
    vibration_report,
)

UNITS = {
    "inertia": "kg·m²",
    "damping": "N·m·s/rad",
    "coulomb": "N·m",
    "delay": "s",
    "torque_gain": "",
}
WORDS = {"coulomb": "Coulomb friction", "torque_gain": "torque gain"}


def row_text(found: Identified, name: str) -> str:
    """Format one value with its standard error: "inertia 0.01195 ± 0.0000063 kg·m²"."""
    estimated: Estimated = getattr(found, name)
    word = WORDS.get(name, name)
    if name == "delay":
        return f"{word} {estimated.in_ms()}"
    return f"{word} {estimated} {UNITS[name]}".rstrip()


def report(found: Identified) -> dict[str, Any]:
    """Return the contract's keys, and the data of the fit."""
    return {
        **{name: getattr(found, name).report() for name in UNITS},
        "torque_unit": "measured" if found.gain_measured else "commanded",
        "backlash": None if found.backlash is None else found.backlash.report(),
        "effects": found.effects,
        "vibration": vibration_report(found.vibration),
        "residual_rad": found.residual,
        "noise_rad": found.noise,
        "rounding_rad": found.rounding,
        "warnings": list(found.warnings),
        "logs": [str(log) for log in found.logs],
    }


def residual_text(found: Identified) -> str:
    """Say how large the residual is, and which part of it is noise.

    The noise is estimated on its own, and may come out above the residual: then it is all of it.
    """
    noise = min(found.noise, found.residual)
    return f"residual {1e3 * found.residual:.3g} mrad, {1e3 * noise:.3g} by noise and rounding"


def text(found: Identified) -> str:
    """Format the identification for people."""
    lines = [f"  {row_text(found, name)}" for name in UNITS if name != "torque_gain"]
    if found.gain_measured:
        lines.append(f"  {row_text(found, 'torque_gain')}: measured over commanded torque")
    else:
        lines.append("  torques in the unit of the commanded torque: no current is measured")
    if found.backlash is None:
        lines.append("  backlash not found: model.backlash stays as it was")
    else:
        lines.append(
            f"  backlash {1e3 * found.backlash.value:.3g} ± {1e3 * found.backlash.stderr:.2g} mrad"
        )
    lines += [f"  {line}" for line in vibration_lines(found.vibration)]
    lines.append(f"  {residual_text(found)}")
    warnings = [f"warning: {warning}" for warning in found.warnings]
    return "\n".join(["found, with standard errors", *lines, *warnings])
