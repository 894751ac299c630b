"""Draws the steps' pictures, and the verdict's: the guard's limits over the virtual damping."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_wall.controller.experiments.commission.steps import Plot, Step
from haptic_wall.controller.experiments.commission.verdict import GuardQuestion
from haptic_wall.controller.guard.limits import evaluate, least_of
from haptic_wall.controller.report import style
from haptic_wall.controller.report.identify import plot_identification
from haptic_wall.controller.report.limit_curves import draw_limits
from haptic_wall.controller.report.sweep import plot_sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLOTS: dict[Step, Plot] = {"identify": plot_identification, "sweep": plot_sweep}
"""The function that draws each step's picture"""
_POINTS = 241
_BEYOND = 1.8
"""End of the damping axis, as a multiple of the best virtual damping"""


def draw_allowed(question: GuardQuestion, report: Mapping[str, Any], path: Path) -> None:
    """Draw the allowed stiffness, and the report's walls, as PNG.

    Raises:
        OSError: The file cannot be written.
    """
    verdict = report["verdict"]
    best = verdict["best"]["commanded"]
    capped = float(question.walls(np.array([1e12])).damping[0])
    last = min(max(_BEYOND * best["damping"], 0.02 * capped), capped)
    damping = np.linspace(0.0, last, _POINTS)
    limits = evaluate(question.walls(damping))
    least = least_of(limits)
    with style.picture(path, style.PAGE, 3.2) as figure:
        ax = figure.subplots()
        ax.fill_between(
            damping,
            0.0,
            verdict["margin"] * least,
            color=style.FAINT,
            linewidth=0,
            label=f"allowed: {verdict['margin']:g} of the smallest",
        )
        draw_limits(ax, damping, limits, np.inf)
        top = float(np.max(least))
        top = max(top, _measured(ax, report, last))
        _walls(ax, verdict)
        ax.set_xlim(0.0, last)
        ax.set_ylim(0.0, 1.15 * top)
        ax.set_xlabel(style.VIRTUAL_DAMPING)
        ax.set_ylabel(style.STIFFNESS)
        style.grid(ax)
        figure.legend(loc="outside right upper")


def _walls(ax: Axes, verdict: Mapping[str, Any]) -> None:
    look: dict[str, Any] = {"color": style.INK, "linestyle": " ", "clip_on": False, "zorder": 5}
    for case, marker, size, label in (
        ("plain", "o", 5, "without virtual damping"),
        ("best", "*", 10, "stiffest"),
        ("configured", "s", 4, "of the configuration"),
    ):
        wall = verdict[case]["commanded"]
        text = f"{label}: {wall['stiffness']:.3g}"
        ax.plot(
            wall["damping"], wall["stiffness"], marker=marker, markersize=size, label=text, **look
        )


def _measured(ax: Axes, report: Mapping[str, Any], last: float) -> float:
    """Draw the sweep's points at the configured delay; return the highest."""
    points = [p for p in report["agreement"]["boundary"] or () if p["measured"] is not None]
    if not points:
        return 0.0
    least = min(point["delay_steps"] for point in points)
    shown = [p for p in points if p["delay_steps"] == least and p["virtual_damping"] <= last]
    if not shown:
        return 0.0
    stiffness = [point["measured"] for point in shown]
    ax.errorbar(
        [point["virtual_damping"] for point in shown],
        stiffness,
        [2.0 * (point["stderr"] or 0.0) for point in shown],
        clip_on=False,
        fmt="o",
        color=style.ORANGE,
        markersize=3.5,
        capsize=2.5,
        elinewidth=0.8,
        label="measured limit at its kick,\nfriction helping",
    )
    return float(max(stiffness))
