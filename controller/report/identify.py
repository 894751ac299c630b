"""Draws an identification: measured and fitted motion, the torque, and the residual."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptic_wall.controller.experiments.identify.identification import Identified, whole_motion
from haptic_wall.controller.experiments.identify.text import row_text
from haptic_wall.controller.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PARTS = 3.0
"""Height of the first panel relative to the others"""


def plot_identification(found: Identified, name: str, path: Path) -> None:
    """Draw the data of the model's fit, as PNG.

    Args:
        found: The identification.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    motion = whole_motion(found)
    begin = float(motion.position[0])
    with style.picture(path, style.PAGE, 5.6) as figure:
        figure.suptitle(_title(found, name), fontsize=8.5, ha="left", x=0.01)
        axes = figure.subplots(3, 1, sharex=True, height_ratios=[_PARTS, 1.3, 1.3])
        axes[0].plot(motion.sampled, motion.position - begin, color=style.INK, linewidth=0.7)
        _fitted(axes[0], axes[2], found, begin)
        axes[0].set_ylabel("position [rad]")
        axes[1].step(motion.sent, motion.torque, where="post", color=style.GREY, linewidth=0.7)
        axes[1].set_ylabel(r"torque [N$\cdot$m]")
        axes[2].set_ylabel("residual [mrad]")
        axes[2].set_xlabel("time [s]")
        for ax in axes:
            style.grid(ax)
        axes[0].plot([], [], color=style.INK, linewidth=0.7, label="measured")
        axes[0].plot(
            [], [], color=style.ORANGE, linewidth=1.0, linestyle="--", label="fitted, in pieces"
        )
        axes[0].plot([], [], color=style.GREY, linewidth=0.6, linestyle=":", label="half a count")
        style.legend_above(axes[0], columns=3)


def _fitted(ax: Axes, below: Axes, found: Identified, begin: float) -> None:
    pieces = found.fit.pieces
    level = 1e3 * found.rounding * np.sqrt(3.0)
    for time, measured, fitted, held in zip(
        pieces.sampled, pieces.position, found.fit.fitted, pieces.held, strict=True
    ):
        t = time[held]
        ax.plot(t, fitted[held] - begin, color=style.ORANGE, linewidth=1.0, linestyle="--")
        below.plot(t, 1e3 * (fitted - measured)[held], color=style.BLUE, linewidth=0.5)
    for sign in (-1.0, 1.0):
        below.axhline(sign * level, color=style.GREY, linewidth=0.6, linestyle=":")


def _title(found: Identified, name: str) -> str:
    rows = [row_text(found, key) for key in ("inertia", "damping", "coulomb", "delay")]
    left = f"residual {1e3 * found.residual:.3g} mrad, {1e3 * found.noise:.3g} by noise"
    return f"{style.titled(name)}: {rows[0]}, {rows[1]},\n{rows[2]}, {rows[3]}; {left}"
