"""Draws a Z-width: stiffness over virtual damping."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_wall.controller.experiments.zwidth import Width
from haptic_wall.controller.report import style
from haptic_wall.controller.settings.model import Wall

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINEAR = 0.5
"""End of the nearly linear part of the damping axis, over the guard's best damping"""


def plot_zwidth(widths: Sequence[Width], wall: Wall, name: str, path: Path) -> None:
    """Draw a Z-width as PNG.

    Args:
        widths: The result.
        wall: The wall of the configuration.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    with style.picture(path, 0.8 * style.PAGE, 4.2) as figure:
        figure.suptitle(f"{style.titled(name)}: Z-width", fontsize=9, ha="left", x=0.01)
        shown = [width for width in widths if width.reason is None]
        _plane(figure.subplots(), shown, wall)
        figure.legend(handles=_legend(shown), loc="outside lower center", ncols=2, fontsize=7)


def _plane(ax: Axes, widths: list[Width], wall: Wall) -> None:
    from matplotlib.ticker import FixedLocator

    top = 1e-9
    least = np.inf
    for width, colour in zip(widths, style.shades(len(widths)), strict=True):
        own = width.guard
        ax.plot(width.virtual_damping, width.exact, color=colour, linewidth=0.9)
        ax.plot(width.virtual_damping, own, color=colour, linewidth=1.4, linestyle=style.DASHED)
        best = width.peak(own)
        top = max(top, best["virtual_damping"] if best is not None else 0.0)
        positive = [*width.exact[width.exact > 0.0], *own[np.isfinite(own) & (own > 0.0)]]
        least = min([least, *positive[:1]])
    ax.plot([wall.damping], [wall.stiffness], "*", color=style.INK, ms=7)
    ax.set_xscale("asinh", linear_width=_LINEAR * top)
    decades = 10.0 ** np.arange(np.ceil(np.log10(0.2 * top)), 9.0)
    ax.xaxis.set_major_locator(FixedLocator([0.0, *decades.tolist()]))
    ax.set_yscale("log")
    ax.set_xlim(left=0.0)
    if np.isfinite(least):
        ax.set_ylim(bottom=0.3 * min(least, max(wall.stiffness, 1e-9)))
    ax.set_xlabel(style.VIRTUAL_DAMPING)
    ax.set_ylabel(style.STIFFNESS)
    style.grid(ax)


def _legend(widths: list[Width]) -> list[Any]:
    colours = style.shades(len(widths))
    keys = [
        style.key(width.velocity.label, color=colour, linewidth=2.5)
        for width, colour in zip(widths, colours, strict=True)
    ]
    keys.append(style.key("exact, two-sided, no friction", linewidth=0.9))
    keys.append(style.key("the guard", linewidth=1.4, linestyle=style.DASHED))
    return [*keys, style.key("the wall of CONFIG", marker="*", ms=7, linestyle=" ")]
