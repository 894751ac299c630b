"""Computes and draws Figs. 3 to 6: exact boundaries over virtual damping."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptic_wall.controller.paper.curves import (
    Curve,
    FigureData,
    dimensionless,
    exact_at,
    exact_boundary,
    linear_at,
)
from haptic_wall.controller.report import style
from haptic_wall.controller.theory.boundary import chain_peak
from haptic_wall.controller.theory.chain import one_mass

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DELTA = 1e-4
"""Viscous damping of all four figures; the paper says delta < 1e-3."""
WHOLE_DELAYS = (0.0, 1.0)
DELAYS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
_NEAR = 0.1
"""Figure 6 ends here in beta: far enough to show the straight lines leave the curves."""


def figure_3() -> FigureData:
    """Return the full boundaries for d = 0 and d = 1, and their peaks."""
    return dimensionless(_whole(WHOLE_DELAYS))


def figure_4() -> FigureData:
    """Return the boundaries of figure 3 within a few delta of the origin, and the lines."""
    beta = DELTA * np.linspace(-1.0, 8.0, 91)
    return dimensionless(
        curve(DELTA, delay, beta) for curve in (exact_at, linear_at) for delay in WHOLE_DELAYS
    )


def figure_5() -> FigureData:
    """Return the full boundaries for all eight delays, and their peaks."""
    return dimensionless(_whole(DELAYS))


def figure_6() -> FigureData:
    """Return the boundaries of figure 5 near the origin, and the straight lines."""
    far = np.geomspace(5 * DELTA, _NEAR, 80)
    beta = np.concatenate([DELTA * np.linspace(-1.0, 4.5, 56), far])
    return dimensionless(
        curve(DELTA, delay, beta) for curve in (exact_at, linear_at) for delay in DELAYS
    )


def _whole(delays: tuple[float, ...]) -> list[Curve]:
    servos, _ = one_mass(1.0, np.full(len(delays), DELTA))
    summits = chain_peak(servos, 1.0, delays)
    return [exact_boundary(DELTA, delay) for delay in delays] + [
        Curve("peak", {"delta": DELTA, "delay_periods": delay}, np.array([x]), np.array([y]))
        for delay, x, y in zip(delays, summits.virtual_damping, summits.stiffness, strict=True)
    ]


def draw_figure_3(data: FigureData, path: Path) -> None:
    """Draw both boundaries, the stable areas below them, and the peaks."""
    with style.picture(path, style.COLUMN, 2.7) as figure:
        ax = figure.subplots()
        for delay, color, fill in _pair():
            (curve,) = data.of_kind("exact", delay_periods=delay)
            ax.fill_between(curve.x, curve.y, color=fill, linewidth=0)
            ax.plot(curve.x, curve.y, color=color)
            (top,) = data.of_kind("peak", delay_periods=delay)
            x, y = float(top.x[0]), float(top.y[0])
            ax.plot(x, y, "o", color=color, markersize=4)
            ax.annotate(
                f"{y:.4f} at $\\beta$ = {x:.3f}",
                (x, y),
                xytext=(3, 5) if delay else (-3, 5),
                textcoords="offset points",
                ha="left" if delay else "right",
                color=color,
            )
        ax.text(1.44, 0.50, r"$d$ = 0", color=style.BLUE)
        ax.text(0.75, 0.095, r"$d$ = 1", color=style.ORANGE)
        ax.text(0.95, 0.36, "stable without delay", color=style.BLUE, ha="center")
        ax.text(0.42, 0.05, "stable for both", color=style.ORANGE, ha="center")
        ax.set_xlim(0.0, 2.1)
        ax.set_ylim(0.0, 0.78)
        _axes(ax)


def draw_figure_4(data: FigureData, path: Path) -> None:
    """Draw both boundaries within a few delta of the origin; the axes are in units of delta."""
    with style.picture(path, style.COLUMN, 2.7) as figure:
        ax = figure.subplots()
        for delay, color, fill in _pair():
            (curve,) = data.of_kind("exact", delay_periods=delay)
            ax.fill_between(curve.x / DELTA, curve.y / DELTA, color=fill, linewidth=0)
            ax.plot(curve.x / DELTA, curve.y / DELTA, color=color, label=f"exact, $d$ = {delay:g}")
        for delay in WHOLE_DELAYS:
            (line,) = data.of_kind("linear", delay_periods=delay)
            label = "" if delay else "linear (16)"
            _dashed(ax, line, DELTA, label)
        ax.legend(loc="upper left", bbox_to_anchor=(0.11, 1.0))
        ax.axvspan(-2.0, -1.0, color="#eeeeee", linewidth=0)
        ax.text(-1.5, 9.0, "no stable stiffness", rotation=90, ha="center", va="center")
        ax.set_xlim(-2.0, 8.0)
        ax.set_ylim(0.0, 18.0)
        _in_delta(ax, [-1, 0, 2, 4, 6, 8], [0, 5, 10, 15])
        _axes(ax)


def draw_figure_5(data: FigureData, path: Path) -> None:
    """Draw all eight boundaries and their peaks."""
    with style.picture(path, style.COLUMN, 3.0) as figure:
        ax = figure.subplots()
        for delay, color in zip(DELAYS, style.shades(len(DELAYS)), strict=True):
            (curve,) = data.of_kind("exact", delay_periods=delay)
            ax.plot(curve.x, curve.y, color=color, label=f"{delay:g}")
            (top,) = data.of_kind("peak", delay_periods=delay)
            ax.plot(top.x, top.y, "o", color=color, markersize=2.5)
        ax.legend(title=r"$d = t_d/T$", loc="upper right", handlelength=1.4)
        ax.set_xlim(0.0, 2.25)
        ax.set_ylim(0.0, 0.72)
        _axes(ax)


def draw_figure_6(data: FigureData, path: Path) -> None:
    """Draw the eight boundaries near the origin, the straight lines, and an inset."""
    with style.picture(path, style.COLUMN, 3.3) as figure:
        ax = figure.subplots()
        inset = ax.inset_axes((0.12, 0.56, 0.42, 0.40))
        for delay, color in zip(DELAYS, style.shades(len(DELAYS)), strict=True):
            (curve,) = data.of_kind("exact", delay_periods=delay)
            (line,) = data.of_kind("linear", delay_periods=delay)
            ax.plot(curve.x, curve.y, color=color, label="" if delay else "exact")
            _dashed(ax, line, 1.0, "" if delay else "linear (16)")
            inset.plot(curve.x / DELTA, curve.y / DELTA, color=color)
            _dashed(inset, line, DELTA, "")
            label = f"$d$ = {delay:g}" if delay == 0 else f"{delay:g}"
            ax.annotate(
                label,
                (curve.x[-1], curve.y[-1]),
                xytext=(3, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
            )
        ax.legend(loc="upper left", bbox_to_anchor=(0.55, 1.0), handlelength=1.6)
        ax.set_xlim(0.0, _NEAR)
        ax.set_ylim(0.0, 0.21)
        inset.set_xlim(-2.0, 4.0)
        inset.set_ylim(0.0, 10.0)
        _in_delta(inset, [-1, 0, 1, 2, 3], [0, 5, 10])
        inset.tick_params(labelsize=7)
        style.grid(inset)
        _axes(ax)


def _pair() -> list[tuple[float, str, str]]:
    """Return delay, line and fill of the two boundaries of figures 3 and 4."""
    return [(0.0, style.BLUE, style.FAINT), (1.0, style.ORANGE, "#f9e3d3")]


def _dashed(ax: Axes, line: Curve, unit: float, label: str) -> None:
    ax.plot(line.x / unit, line.y / unit, "--", color=style.INK, linewidth=0.7, label=label or "_")


def _in_delta(ax: Axes, x: list[int], y: list[int]) -> None:
    """Set ticks at multiples of delta."""

    def name(value: int) -> str:
        return "0" if value == 0 else rf"${value if abs(value) != 1 else str(value)[:-1]}\delta$"

    ax.set_xticks(x, [name(value) for value in x])
    ax.set_yticks(y, [name(value) for value in y])


def _axes(ax: Axes) -> None:
    ax.set_xlabel(style.BETA)
    ax.set_ylabel(style.ALPHA)
    style.grid(ax)
