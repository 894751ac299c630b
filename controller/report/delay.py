"""Draws a measured delay: the lag that each run found, over the delay inserted in it."""

from __future__ import annotations

from pathlib import Path

from haptic_wall.controller.experiments.delay import LoopDelay
from haptic_wall.controller.report.style import GREY, INK, PAGE, grid, picture, titled

_SIGMAS = 2.0


def plot_delay(found: LoopDelay, name: str, path: Path) -> None:
    """Draw a measured delay as PNG.

    Args:
        found: The result.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    device = found.device
    with picture(path, PAGE, 2.6) as figure:
        figure.suptitle(
            f"{titled(name)}: delay from sample to motion {found.total.in_ms()}",
            fontsize=8.5,
            ha="left",
            x=0.01,
        )
        ax = figure.subplots()
        low, high = (1e3 * (device.value + sign * _SIGMAS * device.stderr) for sign in (-1, 1))
        ax.axhspan(low, high, color=GREY, alpha=0.3, linewidth=0.0, label="all runs")
        for number, point in enumerate(found.points):
            lag = point.device
            ax.errorbar(
                1e3 * point.inserted,
                1e3 * lag.value,
                1e3 * _SIGMAS * lag.stderr,
                fmt="o",
                color=INK,
                markersize=4,
                capsize=3,
                linewidth=0.8,
                label=None if number else "one run, two standard errors",
            )
        ax.margins(x=0.3)
        ax.set_xlabel("inserted delay  [ms]")
        ax.set_ylabel("lag, sending to motion  [ms]")
        grid(ax)
        figure.legend(loc="outside right upper")
