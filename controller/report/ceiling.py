"""Draws the growth rate of a vibration over the virtual damping, and the measured ceiling."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_wall.controller.experiments.sweep.ceiling import CeilingResult
from haptic_wall.controller.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIGMAS = 2.0
"""Half length of the error bars in standard errors"""


def plot_ceiling(results: Sequence[CeilingResult], name: str, path: Path) -> None:
    """Draw growth rates and ceilings, a colour for each delay; the believed ceiling is dotted.

    Args:
        results: One result for each delay.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    colours = style.shades(len(results))
    with style.picture(path, 0.8 * style.PAGE, 3.4) as figure:
        ax = figure.subplots()
        ax.axhline(0.0, color=style.GREY, linewidth=0.6)
        for result, colour in zip(results, colours, strict=True):
            _one_delay(ax, result, colour)
        ax.set_xscale("log")
        ax.set_title(f"{name}: the ceiling of the virtual damping", fontsize=8.5, loc="left")
        ax.set_xlabel(style.VIRTUAL_DAMPING)
        ax.set_ylabel("growth of the vibration [1/s]")
        ax.legend(loc="upper left")
        style.grid(ax)


def _one_delay(ax: Axes, result: CeilingResult, colour: str) -> None:
    known = [t for t in result.trials if t.growth_per_s is not None]
    label = f"{1e3 * result.delay_s:.3g} ms"
    if result.measured is not None:
        label += f": {result.measured:.3g} ± {result.uncertainty or 0.0:.1g}"
        ax.axvline(result.measured, color=colour, linewidth=0.8)
    if result.exact < result.rigid:
        ax.axvline(result.exact, color=colour, linewidth=0.8, linestyle=":")
    ax.errorbar(
        [t.virtual_damping for t in known],
        [t.growth_per_s or 0.0 for t in known],
        yerr=[_SIGMAS * (t.stderr or 0.0) for t in known],
        fmt="o",
        markersize=3,
        linewidth=0.8,
        color=colour,
        label=label,
    )
