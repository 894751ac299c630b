"""Draws a fit of a servo's motion: measured and fitted positions, the torque, and the residual."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from haptic_wall.controller.experiments.identify.identification import Identified
from haptic_wall.controller.experiments.identify.motion import Motion, Pieces, motion_of
from haptic_wall.controller.experiments.identify.text import row_text
from haptic_wall.controller.experiments.recorded.estimate import Recorded
from haptic_wall.controller.experiments.recorded.text import UNITS
from haptic_wall.controller.report import style
from haptic_wall.controller.theory.checks import FloatArray

_PARTS, _HEIGHT = (3.0, 1.3, 1.3), 5.6
"""Relative heights of the panels: position, torque, residual; height of all three [inch]"""


def plot_identification(found: Identified, name: str, path: Path) -> None:
    """Draw the data of the model's fit, as PNG.

    Args:
        found: The identification.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    rows = [row_text(found, key) for key in ("inertia", "damping", "coulomb", "delay")]
    left = f"residual {1e3 * found.residual:.3g} mrad, {1e3 * found.noise:.3g} by noise"
    title = f"{style.titled(name)}: {rows[0]}, {rows[1]},\n{rows[2]}, {rows[3]}; {left}"
    half = np.sqrt(3.0) * found.rounding
    _plot_fit(title, [motion_of(found.played.rows)], found.fit.pieces, found.fit.fitted, half, path)


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
    values = [
        f"{word} {each} {UNITS[word]}"
        for word in ("inertia", "damping", "coulomb")
        if (each := found.known.get(word)) is not None
    ]
    said = ", ".join(values) or "no scale"
    left = f"residual {np.round(1e3 * shot.residual, 2)} mrad"
    title = f"{style.titled(name)}: {found.chosen},\n{said}; {left}"
    _plot_fit(title, found.stretches, shot.pieces, shot.fitted, 0.5 * found.step, path)


def _plot_fit(
    title: str,
    motions: Sequence[Motion],
    pieces: Pieces,
    fitted: FloatArray,
    half: float,
    path: Path,
) -> None:
    """Draw motions, the fit to their pieces, and half a count of the encoder [rad]."""
    torque = any(motion.driven for motion in motions)
    parts = [*_PARTS[: 1 + torque], _PARTS[-1]]
    with style.picture(path, style.PAGE, _HEIGHT * sum(parts) / sum(_PARTS)) as figure:
        figure.suptitle(title, fontsize=8.5, ha="left", x=0.01)
        axes = figure.subplots(len(parts), 1, sharex=True, height_ratios=parts)
        above, below = axes[0], axes[-1]
        for motion in motions:
            above.plot(motion.sampled, motion.position, color=style.INK, linewidth=0.7)
            if torque:
                look = {"where": "post", "color": style.GREY, "linewidth": 0.7}
                axes[1].step(motion.sent, motion.torque, **look)
                axes[1].set_ylabel(r"torque [N$\cdot$m]")
        for time, measured, model, held in zip(
            pieces.sampled, pieces.position, fitted, pieces.held, strict=True
        ):
            t, left = time[held], 1e3 * (model - measured)[held]
            above.plot(t, model[held], color=style.ORANGE, linewidth=1.0, linestyle="--")
            below.plot(t, left, color=style.BLUE, linewidth=0.5)
        for sign in (-1e3, 1e3):
            below.axhline(sign * half, color=style.GREY, linewidth=0.6, linestyle=":")
        above.set_ylabel("position [rad]")
        below.set_ylabel("residual [mrad]")
        below.set_xlabel("time [s]")
        for ax in axes:
            style.grid(ax)
        dashed = {"color": style.ORANGE, "linewidth": 1.0, "linestyle": "--"}
        above.plot([], [], color=style.INK, linewidth=0.7, label="measured")
        above.plot([], [], label="fitted, in pieces", **dashed)
        above.plot([], [], color=style.GREY, linewidth=0.6, linestyle=":", label="half a count")
        style.legend_above(above, columns=3)
