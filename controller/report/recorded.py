"""Draws a recorded motion, the fit to it, and the residual."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_wall.controller.experiments.recorded.estimate import Recorded
from haptic_wall.controller.experiments.recorded.text import UNITS
from haptic_wall.controller.report import style


def plot_recorded(found: Recorded, name: str, path: Path) -> None:
    """Draw measured and fitted motion, and the residuals, as PNG.

    Args:
        found: The estimates from the record, with a fit.
        name: Name of the record, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    shot = found.shot
    assert shot is not None, "without a fit there is nothing to draw"
    with style.picture(path, style.PAGE, 4.4) as figure:
        figure.suptitle(_title(found, name), fontsize=8.5, ha="left", x=0.01)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2.4, 1.0])
        for stretch in found.stretches:
            above.plot(stretch.sampled, stretch.position, color=style.INK, linewidth=0.7)
        for time, fitted, left, held in zip(
            shot.pieces.sampled, shot.fitted, -shot.linear.left, shot.pieces.held, strict=True
        ):
            above.plot(time[held], fitted[held], color=style.ORANGE, linewidth=1.0, linestyle="--")
            below.plot(time[held], 1e3 * left[held], color=style.BLUE, linewidth=0.6)
        for sign in (-0.5, 0.5):
            below.axhline(sign * 1e3 * found.step, color=style.GREY, linewidth=0.6, linestyle=":")
        above.set_ylabel("position [rad]")
        below.set_ylabel("residual [mrad]")
        below.set_xlabel("time [s]")
        for ax in (above, below):
            style.grid(ax)
        above.plot([], [], color=style.INK, linewidth=0.7, label="measured")
        above.plot(
            [], [], color=style.ORANGE, linewidth=1.0, linestyle="--", label="fitted, in pieces"
        )
        above.plot([], [], color=style.GREY, linewidth=0.6, linestyle=":", label="half a count")
        style.legend_above(above, columns=3)


def _title(found: Recorded, name: str) -> str:
    values = [
        f"{word} {each} {UNITS[word]}"
        for word in ("inertia", "damping", "coulomb")
        if (each := found.known.get(word)) is not None
    ]
    left = 0.0 if found.residual is None else 1e3 * found.residual
    said = ", ".join(values) or "no scale"
    return f"{style.titled(name)}: {found.chosen},\n{said}; residual {np.round(left, 2)} mrad"
