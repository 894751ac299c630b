"""Computes and draws Fig. 10: exact boundaries, and points of 2 % and 5 % error of the line."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from haptic_wall.controller.paper.boundaries import DELAYS
from haptic_wall.controller.paper.curves import (
    Curve,
    FigureData,
    dimensionless,
    exact_at,
    linear_at,
)
from haptic_wall.controller.report import style
from haptic_wall.controller.theory import max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.roots import zeros

DELTAS = (0.0, 0.01)
"""Viscous damping of the two panels"""
ERRORS_PERCENT = (2.0, 5.0)
"""Errors of the linear condition, in either direction"""
_REACH = 0.07
"""Figure 10 ends at this beta: it contains all of its points."""
_POINTS, _START = 1024, 1e-6
"""Of the search on one boundary: points, and where it begins, as a fraction of the damping range"""


def figure_10() -> FigureData:
    """Return the exact boundaries, their linear conditions, and the points of equal error."""
    curves: list[Curve] = []
    for delta in DELTAS:
        beta = np.linspace(-delta, _REACH, 161)
        for delay in DELAYS:
            curves += [exact_at(delta, delay, beta), linear_at(delta, delay, beta)]
    for delta in DELTAS:
        for delay in DELAYS:
            for percent in ERRORS_PERCENT:
                curves += error_points(delta, delay, percent)
    return dimensionless(curves)


def error_points(delta: float, delay: float, percent: float) -> list[Curve]:
    """Return the points of one boundary where the linear condition errs so much, by rising beta.

    With light damping there is one, with the exact limit below the linear one. With more damping
    and delay the boundary starts above it, and the error can pass ``+percent`` first and
    ``-percent`` later; or it is greater from the start.

    Args:
        delta: Viscous damping b T / m >= 0.
        delay: d >= 0 [periods].
        percent: The exact limit over the linear one, minus one, either way, > 0 [%].

    Source: Gil et al., ICRA 2007, Fig. 10.
    """
    width = float(max_virtual_damping(1.0, delta, 1.0, delay)) + delta
    # Denser towards the start, where the error changes as the damping does.
    shares = np.linspace(np.sqrt(_START), 1.0, _POINTS)[:-1] ** 2

    def above(level: float, share: FloatArray) -> FloatArray:
        beta = width * share - delta
        return exact_at(delta, delay, beta).y / linear_at(delta, delay, beta).y - 1.0 - level

    points = []
    for signed in (-percent, percent):
        found = zeros(partial(above, signed / 100.0), shares)
        settings = {"delta": delta, "delay_periods": delay, "error_percent": signed}
        for share in found.tolist():
            beta = np.array([width * share - delta])
            alpha = exact_at(delta, delay, beta).y
            points.append(Curve("error point", settings, beta, alpha))
    return sorted(points, key=lambda point: float(point.x[0]))


def draw_figure_10(data: FigureData, path: Path) -> None:
    """Draw a panel for each delta: boundaries, with marks at the points of equal error."""
    marks = {2.0: "^", -2.0: "v", -5.0: "s"}
    with style.picture(path, style.PAGE, 3.3) as figure:
        panels = figure.subplots(1, 2)
        for ax, delta, letter in zip(panels, DELTAS, "ab", strict=True):
            for delay, color in zip(DELAYS, style.shades(len(DELAYS)), strict=True):
                (curve,) = data.of_kind("exact", delta=delta, delay_periods=delay)
                (line,) = data.of_kind("linear", delta=delta, delay_periods=delay)
                ax.plot(curve.x, curve.y, color=color)
                ax.plot(line.x, line.y, "--", color=style.GREY, linewidth=0.5)
                ax.annotate(
                    f"$d$ = {delay:g}" if delay == 0 else f"{delay:g}",
                    (curve.x[-1], curve.y[-1]),
                    xytext=(3, 0),
                    textcoords="offset points",
                    va="center",
                    fontsize=7.5,
                )
            for percent, mark in marks.items():
                found = data.of_kind("error point", delta=delta, error_percent=percent)
                if not found:
                    continue
                ax.plot(
                    [float(p.x[0]) for p in found],
                    [float(p.y[0]) for p in found],
                    mark,
                    color=style.INK,
                    markerfacecolor="white",
                    markersize=4,
                    markeredgewidth=0.8,
                    linestyle="none",
                    clip_on=False,
                    zorder=3,
                    label=f"{percent:+g} %".replace("-", "−"),
                )
            ax.set_title(rf"({letter})  $\delta$ = {delta:g}", loc="left", fontsize=9)
            ax.set_xlabel(style.BETA)
            ax.set_ylabel(style.ALPHA)
            ax.set_xlim(-delta, _REACH)
            ax.set_ylim(0.0, 0.165)
            style.grid(ax)
        panels[1].legend(loc="upper left", title="exact boundary off the line by")
