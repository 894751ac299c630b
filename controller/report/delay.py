"""Draws a measured delay: the motion after a torque step, and the recovered inserted delays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptic_wall.controller.experiments.delay import DelayPoint, LoopDelay
from haptic_wall.controller.experiments.steps.step_fit import DECAY, caused, shapes
from haptic_wall.controller.guard.delay_parts import ms
from haptic_wall.controller.report.style import GREY, INK, PAGE, grid, picture, shades, titled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BINS = 40
_SPAN = 12e-3
"""Drawn time after the onset [s]"""
_BEFORE = 4e-3
_SIGMAS = 2.0
_POINTS, _WIDTHS = 3, (2.2, 1.0)
"""Number of recovered delays from which they get axes of their own, and the widths of both axes"""


def plot_delay(found: LoopDelay, name: str, path: Path) -> None:
    """Draw a measured delay as PNG.

    Args:
        found: The result.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    colours = shades(len(found.points))
    recovered = [point for point in found.points if point.recovered is not None]
    with picture(path, PAGE, 3.2) as figure:
        figure.suptitle(
            f"{titled(name)}: delay from sample to motion {found.total.in_ms()}",
            fontsize=8.5,
            ha="left",
            x=0.01,
        )
        if len(recovered) >= _POINTS:
            left, right = figure.subplots(1, 2, width_ratios=_WIDTHS)
            _recovered(right, recovered)
            grid(right)
        else:
            left = figure.subplots()
        for point, colour in zip(found.points, colours, strict=True):
            _motion(left, point, colour)
        left.set_xlabel("time since the sample of the torque  [ms]")
        left.set_ylabel("motion per torque step  [mrad / (N$\\cdot$m)]")
        grid(left)
        figure.legend(loc="outside right upper")


def _motion(ax: Axes, point: DelayPoint, colour: str) -> None:
    """Draw the mean motion after the steps, and the fitted one."""
    fit = point.commanded
    time, motion = caused(fit)
    near = (time > fit.lag - _BEFORE) & (time < fit.lag + _SPAN)
    edges = np.linspace(fit.lag - _BEFORE, fit.lag + _SPAN, _BINS + 1)
    place = np.digitize(time[near], edges) - 1
    count = np.bincount(place, minlength=_BINS)
    some = count > 0
    at = np.bincount(place, time[near], _BINS)[some] / count[some]
    mean = np.bincount(place, motion[near], _BINS)[some] / count[some]
    ax.plot(1e3 * at, 1e3 * mean, ".", color=colour, markersize=3)
    curve = np.linspace(edges[0], edges[-1], 200)
    _, twice = shapes(float(fit.values[DECAY]), np.maximum(curve - fit.lag, 0.0))
    label = f"{ms(point.inserted)} inserted"
    if point.recovered is not None:
        back = point.recovered
        label += f",\n{back.in_ms()} recovered"
    ax.plot(1e3 * curve, 1e3 * fit.acceleration * twice, color=colour, linewidth=0.8, label=label)
    ax.axvline(1e3 * fit.lag, color=colour, linewidth=0.5, linestyle=":")


def _recovered(ax: Axes, points: Sequence[DelayPoint]) -> None:
    """Draw the error of each recovered delay."""
    for point in points:
        assert point.recovered is not None
        ax.errorbar(
            1e3 * point.inserted,
            1e6 * (point.recovered.value - point.inserted),
            1e6 * _SIGMAS * point.recovered.stderr,
            fmt="o",
            color=INK,
            markersize=4,
            capsize=3,
            linewidth=0.8,
        )
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    ax.margins(x=0.3)
    ax.set_xlabel("inserted delay  [ms]")
    ax.set_ylabel("recovered $-$ inserted  [µs],\ntwo standard errors")
