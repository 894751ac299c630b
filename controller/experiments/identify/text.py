"""Formats an identification in words and as JSON for outside tools."""

from __future__ import annotations

import math
from typing import Any

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.boundary_fit import BoundaryFit
from haptic_wall.controller.experiments.identify.identification import Identified
from haptic_wall.controller.experiments.identify.vibration import (
    vibration_lines,
    vibration_report,
)
from haptic_wall.controller.settings.config import Config

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


def boundary_report(fit: BoundaryFit) -> dict[str, Any]:
    """Return the figures of a measured boundary for the report."""
    return {
        "damping": fit.damping.report(),
        "delay": fit.delay.report(),
        "line": None
        if fit.line_damping is None or fit.line_delay is None
        else {"damping": fit.line_damping.report(), "delay": fit.line_delay.report()},
        "points": fit.used,
        "straight_points": fit.straight,
    }


def comparison(
    motion: tuple[Estimated, Estimated], boundary: tuple[Estimated, Estimated]
) -> dict[str, Any]:
    """Compare two answers for damping and delay: difference, and agreement within two errors."""
    compared = {}
    for name, one, other in zip(("damping", "delay"), motion, boundary, strict=True):
        error = math.hypot(one.stderr, other.stderr)
        difference = other.value - one.value
        compared[name] = {
            "difference": difference,
            "stderr": error,
            "agree": abs(difference) <= 2.0 * error,
        }
    return compared


def believed(config: Config) -> tuple[Estimated, Estimated]:
    """Return damping and delay of the belief; a quarter of its bounds' width is the error."""
    belief = config.belief()
    damping, delay = (
        Estimated(b.value, 0.25 * (b.high - b.low)) for b in (belief.damping, belief.delay)
    )
    return damping, delay


def text(answer: dict[str, Any], found: Identified | None) -> str:
    """Format the report for people."""
    lines = []
    if found is not None:
        lines += [f"  {row_text(found, name)}" for name in UNITS if name != "torque_gain"]
        if found.gain_measured:
            lines.append(f"  {row_text(found, 'torque_gain')}: measured over commanded torque")
        else:
            lines.append("  torques in the unit of the commanded torque: no current is measured")
        if found.backlash is None:
            lines.append("  backlash not found")
        else:
            lines.append(
                f"  backlash {1e3 * found.backlash.value:.3g} ±"
                f" {1e3 * found.backlash.stderr:.2g} mrad"
            )
        lines += [f"  {line}" for line in vibration_lines(found.vibration)]
        lines.append(
            f"  residual {1e3 * found.residual:.3g} mrad, {1e3 * found.noise:.3g} by noise"
        )
        lines = ["found, with standard errors", *lines]
        lines += [f"warning: {warning}" for warning in found.warnings]
    if (boundary := answer.get("from_sweep")) is not None:
        lines += ["", *_boundary_lines(boundary)]
    return "\n".join(lines)


def _boundary_lines(boundary: dict[str, Any]) -> list[str]:
    lines = [f"from the boundary, {boundary['points']} points"]
    ways = [("exact boundary", boundary)]
    if boundary["line"] is not None:
        ways.append((f"straight line, {boundary['straight_points']} points", boundary["line"]))
    for way, values in ways:
        damping, delay = (Estimated(**values[name]) for name in ("damping", "delay"))
        lines.append(f"  {way}: damping {damping} N·m·s/rad, delay {delay.in_ms()}")
    for name, compared in boundary["compared"].items():
        said = "agree" if compared["agree"] else "do NOT agree"
        lines.append(f"  {name}: the two answers {said} within two standard errors")
    return lines
