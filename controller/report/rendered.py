"""Draws a rendering: the spring's push, and the contacts with the wall."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptic_wall.controller.experiments.rendered.contact_transient import Contact
from haptic_wall.controller.experiments.rendered.rendering import Rendering
from haptic_wall.controller.experiments.rendered.static_stiffness import StaticStiffness
from haptic_wall.controller.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 800
"""Drawn samples of each way"""
_BEFORE, _BEHIND = 0.05, 0.35
"""Drawn time before and after the entry into the wall [s]"""


def plot_rendering(found: Rendering, name: str, path: Path) -> None:
    """Draw a comparison as PNG.

    Args:
        found: The result; missing measurements are omitted.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    with style.picture(path, style.PAGE, 3.2) as figure:
        figure.suptitle(
            f"{style.titled(name)}: commanded K = {found.stiffness:.4g} N·m/rad,"
            f" B = {found.damping:.3g} N·m·s/rad",
            fontsize=8.5,
            ha="left",
            x=0.01,
        )
        axes = figure.subplots(1, 2)
        if found.static is not None:
            _push(axes[0], found.static, found.stiffness)
        _labels(axes[0], "displacement  [rad]", "torque less that of the spring  [N$\\cdot$m]")
        _contacts(axes[1], found.contacts, found.predicted)
        _labels(axes[1], "time since the entry  [s]", "penetration  [rad]")


def _labels(ax: Axes, across: str, up: str) -> None:
    ax.set_xlabel(across)
    ax.set_ylabel(up)
    style.grid(ax)


def _push(ax: Axes, static: StaticStiffness, commanded: float) -> None:
    for up, colour in ((True, style.BLUE), (False, style.ORANGE)):
        way = np.flatnonzero(static.upward == up)
        way = way[:: max(1, way.size // _POINTS)]
        ax.plot(
            static.position[way],
            static.torque[way],
            ".",
            color=colour,
            markersize=2,
            label="up" if up else "down",
        )
    ends = np.array([static.position.min(), static.position.max()])
    ax.plot(ends, commanded * ends, color=style.INK, linewidth=0.8, label="commanded")
    style.legend_above(ax, columns=2)


def _contacts(ax: Axes, struck: tuple[Contact, ...], predicted: tuple[Contact, ...]) -> None:
    for place, (contacts, colour, width, label) in enumerate(
        (
            (struck, style.BLUE, 0.8, "rendered"),
            (predicted, style.GREY, 0.8, "simulated with model.*"),
        )
    ):
        for number, contact in enumerate(contacts):
            near = (contact.time > -_BEFORE) & (contact.time < _BEHIND)
            ax.plot(
                contact.time[near],
                contact.position[near],
                color=colour,
                linewidth=width,
                linestyle="--" if place else "-",
                label=None if number else label,
            )
    ax.axhline(0.0, color=style.INK, linewidth=0.6)
    if struck:
        deepest = max(contact.penetration for contact in struck)
        ax.set_ylim(-deepest, 1.15 * deepest)
        style.legend_above(ax)
