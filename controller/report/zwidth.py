"""Draws a Z-width: stiffness over virtual damping, and the impedance over frequency."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_wall.controller.experiments.zwidth.impedance import Impedance
from haptic_wall.controller.experiments.zwidth.measured import Found
from haptic_wall.controller.experiments.zwidth.plane import Width
from haptic_wall.controller.report import style
from haptic_wall.controller.theory.checks import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINEAR = 1.5
"""Decades of room for the linear part of the damping axis, up to the guard's best damping"""


def plot_zwidth(found: Found, name: str, path: Path) -> None:
    """Draw a Z-width as PNG.

    Args:
        found: The result.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    with style.picture(path, style.PAGE, 4.2) as figure:
        figure.suptitle(f"{style.titled(name)}: Z-width", fontsize=9, ha="left", x=0.01)
        parts: Any = figure.subfigures(1, 2, width_ratios=(1.25, 1.0))
        left, right = parts
        plane = left.subplots()
        shown = [width for width in found.widths if width.config is not None]
        _plane(plane, shown, found)
        left.legend(handles=_legend(shown), loc="outside lower center", ncols=2, fontsize=7)
        stiffness, damping = right.subplots(2, 1, sharex=True)
        _impedance(stiffness, damping, found.impedance)


def _plane(ax: Axes, widths: list[Width], found: Found) -> None:
    top = 1e-9
    least = np.inf
    for width, colour in zip(widths, style.shades(len(widths)), strict=True):
        own = width.guard if np.isfinite(width.guard).any() else width.guard_two_sided
        ax.plot(width.virtual_damping, width.exact, color=colour, linewidth=0.9)
        ax.plot(width.virtual_damping, own, color=colour, linewidth=1.4, linestyle=(0, (3, 1.5)))
        best = width.peak(own)
        top = max(top, best["virtual_damping"] if best is not None else 0.0)
        positive = [*width.exact[width.exact > 0.0], *own[np.isfinite(own) & (own > 0.0)]]
        least = min([least, *positive[:1]])
        points = [point for point in width.points if point.measured is not None]
        ax.errorbar(
            [point.virtual_damping for point in points],
            [point.measured or np.nan for point in points],
            [2.0 * (point.uncertainty or 0.0) for point in points],
            color=colour,
            linestyle=" ",
            marker="o",
            markersize=3.5,
            capsize=2.0,
            elinewidth=0.8,
        )
    ax.plot([found.config.wall.damping], [found.config.wall.stiffness], "*", color=style.INK, ms=7)
    ax.set_xscale("symlog", linthresh=top, linscale=_LINEAR)
    ax.set_yscale("log")
    ax.set_xlim(left=0.0)
    if np.isfinite(least):
        ax.set_ylim(bottom=0.3 * min(least, max(found.config.wall.stiffness, 1e-9)))
    ax.set_xlabel(style.VIRTUAL_DAMPING)
    ax.set_ylabel(style.STIFFNESS)
    style.grid(ax)


def _legend(widths: list[Width]) -> list[Any]:
    from matplotlib.lines import Line2D

    colours = style.shades(len(widths))
    handles = [
        Line2D([], [], color=colour, linewidth=2.5, label=width.velocity.label)
        for width, colour in zip(widths, colours, strict=True)
    ]
    handles.append(
        Line2D([], [], color=style.INK, linewidth=0.9, label="exact, two-sided, no friction")
    )
    dashed = (0, (3, 1.5))
    handles.append(
        Line2D([], [], color=style.INK, linewidth=1.4, linestyle=dashed, label="the guard")
    )
    dot: dict[str, Any] = {"color": style.INK, "linestyle": " "}
    if any(point.measured is not None for width in widths for point in width.points):
        handles.append(Line2D([], [], marker="o", ms=3.5, label="measured, ±2 s.e.", **dot))
    handles.append(Line2D([], [], marker="*", ms=7, label="the wall of CONFIG", **dot))
    return handles


def _impedance(stiffness: Axes, damping: Axes, found: Impedance) -> None:
    hertz = np.array([band.frequency_hz for band in found.bands])
    measured = [band for band in found.bands if band.stiffness is not None]
    at = np.array([band.frequency_hz for band in measured])
    error = np.array([band.stderr or 0.0 for band in measured])
    for ax, part, divisor in (
        (stiffness, "stiffness", np.ones(at.size)),
        (damping, "damping", 2.0 * np.pi * at),
    ):
        ax.plot(
            hertz, _of(found, f"commanded_{part}"), color=style.INK, linewidth=0.9, label="the law"
        )
        ax.plot(
            hertz,
            _of(found, f"acting_{part}"),
            color=style.GREY,
            linestyle=(0, (3, 1.5)),
            linewidth=0.9,
            label="with delay and hold",
        )
        values = np.array([getattr(band, part) for band in measured])
        bars = 2.0 * error / divisor
        label = f"from the torque {found.torque}, ±2 s.e."
        if at.size:
            ax.errorbar(
                at,
                values,
                bars,
                color=style.BLUE,
                marker="o",
                ms=3,
                linestyle=" ",
                capsize=2,
                label=label,
            )
        ax.set_xscale("log")
        style.grid(ax)
    if not at.size:
        told = "measured: not excited" if found.rows else "not measured"
        # Beside the curve, which begins at the bottom left.
        stiffness.text(0.97, 0.06, told, transform=stiffness.transAxes, ha="right")
    stiffness.legend(loc="upper left", fontsize=7)
    stiffness.set_ylabel("effective stiffness\n[N$\\cdot$m/rad]")
    damping.set_ylabel("effective damping\n[N$\\cdot$m$\\cdot$s/rad]")
    damping.set_xlabel("frequency  [Hz]")


def _of(found: Impedance, name: str) -> FloatArray:
    return np.array([getattr(band, name) for band in found.bands])
