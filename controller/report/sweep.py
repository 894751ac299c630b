"""Draws a sweep: measured critical stiffness over virtual damping, with the predicted limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.result import PointResult
from haptic_wall.controller.milliseconds import ms
from haptic_wall.controller.report import style
from haptic_wall.controller.theory.checks import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 160
_EXPECTED: dict[str, Any] = {"marker": "D", "ms": 5, "mfc": "none", "mew": 0.9, "linestyle": " "}
_SIGMAS = 2.0
"""Half length of the error bars in standard errors"""


def plot_sweep(points: Sequence[PointResult], device: Device, name: str, path: Path) -> None:
    """Draw the measured points over the limits, a colour for each inserted delay.

    Args:
        points: Points of any number of delays; one without a figure is a cross on the axis.
        device: The belief, for the curves.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    steps = sorted({point.delay_steps for point in points})
    colours = dict(zip(steps, style.shades(len(steps)), strict=True))
    low, high = _range(points)
    with style.picture(path, 0.8 * style.PAGE, 3.7) as figure:
        figure.suptitle(_title(device, name), fontsize=8.5, ha="left", x=0.01)
        ax = figure.subplots()
        top = 0.0
        for delay_steps in steps:
            own = [point for point in points if point.delay_steps == delay_steps]
            top = max(top, _one_delay(ax, own, device, colours[delay_steps], (low, high)))
        ax.set_xlim(low, high)
        ax.set_ylim(0.0, 1.12 * top if top > 0.0 else 1.0)
        ax.set_xlabel(style.VIRTUAL_DAMPING)
        ax.set_ylabel(style.STIFFNESS)
        style.grid(ax)
        figure.legend(handles=_legend(points, colours), loc="outside right upper")


def _range(points: Sequence[PointResult]) -> tuple[float, float]:
    """Return the ends of the damping axis: of the points with a figure, if any, and a margin."""
    found = [point.virtual_damping for point in points if point.measured is not None]
    found = found or [point.virtual_damping for point in points]
    low, high = min([0.0, *found]), max(found, default=0.0)
    space = 0.06 * max(high - low, abs(high), 1e-3)
    return low - space, high + space


def _one_delay(
    ax: Axes,
    points: Sequence[PointResult],
    device: Device,
    colour: str,
    ends: tuple[float, float],
) -> float:
    """Draw curves and points of one inserted delay; return the greatest stiffness to show."""
    delay = float(np.mean([point.delay_s for point in points]))
    across = np.linspace(*ends, _POINTS)
    exact = np.asarray(device.loop.critical(across, delay).stiffness)
    linear = np.array([device.linear(value, delay) for value in across])
    ax.plot(across, linear, color=colour, linewidth=0.6, linestyle=style.DOTTED)
    ax.plot(across, np.where(exact > 0.0, exact, np.nan), color=colour, linewidth=1.0)
    found = [point for point in points if point.measured is not None]
    stiffness = _values([point.measured for point in found])
    error = _SIGMAS * _values([point.uncertainty for point in found])
    at = np.array([point.virtual_damping for point in found])
    look: dict[str, Any] = {"color": colour, "linestyle": " ", "capsize": 2.5, "elinewidth": 0.8}
    ax.errorbar(at, stiffness, error, marker="o", markersize=3.5, **look)
    if device.coulomb > 0.0:
        predicted = _values([point.predicted_with_friction for point in found])
        ax.plot(at, predicted, color=colour, **_EXPECTED)
    # A point outside the picture is drawn at its edge.
    missing = np.clip([point.virtual_damping for point in points if point.measured is None], *ends)
    ax.plot(
        missing, np.zeros(missing.size), "x", color=colour, markersize=5, clip_on=False, zorder=5
    )
    shown = [float(value) for value in stiffness + error if np.isfinite(value)]
    return max(*shown, float(exact.max()), 0.0)


def _values(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values])


def _legend(points: Sequence[PointResult], colours: dict[int, str]) -> list[Any]:
    keys = []
    for steps, colour in colours.items():
        delay = np.mean([point.delay_s for point in points if point.delay_steps == steps])
        label = f"{ms(float(delay))} ({steps} inserted)"
        keys.append(style.key(label, color=colour, linewidth=2.5))
    keys.append(style.key("measured, ±2 s.e.", marker="o", ms=3.5, linestyle=" "))
    if any(point.predicted_with_friction not in (None, point.exact) for point in points):
        label = "expected with friction\nfor that kick"
        keys.append(style.key(label, **_EXPECTED))
    if any(point.measured is None for point in points):
        keys.append(style.key("no figure: see reason", marker="x", ms=5, linestyle=" "))
    keys.append(style.key("exact, no friction", linewidth=1.0))
    linear = style.key("linear", color=style.GREY, linewidth=0.8, linestyle=style.DOTTED)
    return [*keys, linear]


def _title(device: Device, name: str) -> str:
    return (
        f"{style.titled(name)}: critical stiffness\nbelieved: $m$ {device.loop.inertia:.3g} kg·m²,"
        f" $b$ {device.loop.damping:.3g} N·m·s/rad, Coulomb friction {device.coulomb:.3g} N·m"
    )
