"""Figs. 8 and 9: axis 3 of the DLR Light-Weight Robot III, a two-sided wall without a user.

The paper raises K at fixed B until the oscillation is sustained. It does not print the measured
points, so this module gives only the theory that they are compared with.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from haptic_wall.controller.paper.curves import Curve, FigureData
from haptic_wall.controller.report import style
from haptic_wall.controller.theory import (
    critical_stiffness,
    linear_limit,
    max_virtual_damping,
)
from haptic_wall.controller.theory.boundary import chain_peak
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.controller.theory.checks import FloatArray

INERTIA = 0.8
"""[kg·m²], printed with figure 9"""
DAMPING = 0.1
"""[N·m·s/rad]; assumed: the paper does not print it"""
PERIOD = 1e-3
"""[s]"""
SHORT_DELAYS = (5e-3, 6e-3, 10e-3)
"""Figure 8: the system's own 5 ms with 0, 1 and 5 ms inserted [s]"""
LONG_DELAYS = (10e-3, 55e-3)
"""Figure 9 [s]"""
_SHORT_REACH = 20.0
"""Figure 8 ends at this B [N·m·s/rad]; the paper's own range is not known."""


def figure_8() -> FigureData:
    """Return the straight lines K = (b + B) / (T/2 + t_d)."""
    virtual_damping = np.linspace(0.0, _SHORT_REACH, 41)
    return _plane(_line(delay, virtual_damping) for delay in SHORT_DELAYS)


def figure_9() -> FigureData:
    """Return the exact boundaries with their peaks, and the straight lines."""
    curves = []
    for delay in LONG_DELAYS:
        ceiling = float(max_virtual_damping(INERTIA, DAMPING, PERIOD, delay))
        share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 401))
        virtual_damping = -DAMPING + (ceiling + DAMPING) * share
        stiffness = critical_stiffness(INERTIA, DAMPING, virtual_damping, PERIOD, delay)
        curves.append(_curve("exact", delay, virtual_damping, np.asarray(stiffness)))
        curves.append(_line(delay, virtual_damping))
        top = chain_peak(one_mass(INERTIA, DAMPING)[0], PERIOD, delay)
        curves.append(_curve("peak", delay, top.virtual_damping, top.stiffness))
    return _plane(curves)


def _line(delay: float, virtual_damping: FloatArray) -> Curve:
    stiffness = linear_limit(DAMPING, virtual_damping, PERIOD, delay)
    return _curve("linear", delay, virtual_damping, np.asarray(stiffness))


def _curve(kind: str, delay: float, x: FloatArray, y: FloatArray) -> Curve:
    settings = {"delay_s": delay, "damping_nms_per_rad": DAMPING}
    if kind != "linear":  # the line does not depend on the inertia
        settings["inertia_kgm2"] = INERTIA
    return Curve(kind, settings, x, y)


def _plane(curves: Iterable[Curve]) -> FigureData:
    return FigureData("virtual_damping_nms_per_rad", "stiffness_nm_per_rad", tuple(curves))


def draw_figure_8(data: FigureData, path: Path) -> None:
    """Draw the three straight lines, each with its delay."""
    with style.picture(path, style.COLUMN, 2.7) as figure:
        ax = figure.subplots()
        for delay, color in zip(SHORT_DELAYS, (style.BLUE, style.GREEN, style.ORANGE), strict=True):
            (line,) = data.of_kind("linear", delay_s=delay)
            ax.plot(line.x, line.y, color=color)
            ax.annotate(
                f"{1e3 * delay:g} ms",
                (line.x[-1], line.y[-1]),
                xytext=(3, 0),
                textcoords="offset points",
                va="center",
                color=color,
            )
        formula = r"$K = (b+B)\,/\,(T/2+t_d)$"
        ax.text(0.04, 0.9, formula, transform=ax.transAxes, fontsize=9)
        ax.text(1.015, 0.985, "$t_d$", transform=ax.transAxes, va="bottom")
        ax.set_xlim(0.0, _SHORT_REACH)
        ax.set_ylim(0.0, 4000.0)
        ax.set_xlabel(style.VIRTUAL_DAMPING)
        ax.set_ylabel(style.STIFFNESS)
        style.grid(ax)


def draw_figure_9(data: FigureData, path: Path) -> None:
    """Draw a panel for each delay: the exact boundary, its peak, and the straight line."""
    with style.picture(path, style.COLUMN, 4.2) as figure:
        panels = figure.subplots(2, 1)
        for ax, delay, letter in zip(panels, LONG_DELAYS, "ab", strict=True):
            (curve,) = data.of_kind("exact", delay_s=delay)
            (line,) = data.of_kind("linear", delay_s=delay)
            (top,) = data.of_kind("peak", delay_s=delay)
            x, y = float(top.x[0]), float(top.y[0])
            ax.fill_between(curve.x, curve.y, color=style.FAINT, linewidth=0)
            ax.plot(curve.x, curve.y, color=style.BLUE, label="exact")
            ax.plot(line.x, line.y, "--", color=style.INK, linewidth=0.8, label="linear")
            ax.plot(x, y, "o", color=style.BLUE, markersize=3.5)
            ax.text(x, 0.82 * y, f"{y:.4g} at $B$ = {x:.3g}", ha="center", color=style.BLUE)
            ax.text(x, 0.3 * y, "stable", ha="center", color=style.BLUE)
            ax.set_title(f"({letter})  $t_d$ = {1e3 * delay:g} ms", loc="left", fontsize=9)
            ax.set_xlim(0.0, 1.05 * curve.x[-1])
            ax.set_ylim(0.0, 1.3 * y)
            ax.set_ylabel(style.STIFFNESS)
            style.grid(ax)
        panels[0].legend(loc="upper right")
        panels[-1].set_xlabel(style.VIRTUAL_DAMPING)
