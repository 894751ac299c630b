"""Makes an HTML page of the bench's results, with a picture of each histogram."""

from __future__ import annotations

import time
from collections.abc import Mapping
from io import BytesIO
from typing import TYPE_CHECKING, Any

from haptic_wall.controller.bench import words
from haptic_wall.controller.bench.words import figure
from haptic_wall.controller.report.html import embedded, filled_in
from haptic_wall.controller.report.style import BLUE, GREY, INK, ORANGE, PAGE, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def page(report: Mapping[str, Any]) -> str:
    """Return the page's text.

    Args:
        report: Report from ``report.measured``, or read from the output of ``--json``.
    """
    pictures = {
        name: [
            (embedded(png(histogram)), histogram["name"])
            for histogram in section["histograms"]
            if histogram["series"]
        ]
        for name, section in report["sections"].items()
    }
    return filled_in(
        __package__,
        r=report,
        words=words,
        pictures=pictures,
        written=time.strftime("%Y-%m-%d %H:%M"),
    )


_STRIP, _AXIS = 0.62, 0.55
"""Heights of a strip, and of the space for the axis below [inch]"""


def png(histogram: Mapping[str, Any]) -> bytes:
    """Return the picture of a histogram as PNG.

    Args:
        histogram: Histogram from ``bins.binned``, with at least one series.
    """
    from matplotlib.ticker import FuncFormatter, LogFormatter

    series = histogram["series"]
    into = BytesIO()
    with picture(into, PAGE, _STRIP * len(series) + _AXIS) as drawn:
        rows = drawn.subplots(len(series), 1, sharex=True, squeeze=False)[:, 0]
        for ax, (name, counted) in zip(rows, series.items(), strict=True):
            _strip(ax, histogram, name, counted)
        last: Axes = rows[-1]
        if histogram["scale"] == "log":
            last.set_xscale("log")
            last.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            # Labelled only where there are few decades, as matplotlib decides.
            last.xaxis.set_minor_formatter(LogFormatter())
        last.set_xlabel(f"{histogram['name']} [{histogram['unit']}]")
        last.set_xlim(histogram["edges"][0], histogram["edges"][-1])
    return into.getvalue()


def _strip(ax: Axes, histogram: Mapping[str, Any], name: str, counted: Mapping[str, Any]) -> None:
    unit = histogram["unit"]
    ax.set_yscale("log")
    ax.stairs(counted["counts"], histogram["edges"], baseline=0.5, fill=True, color=BLUE, alpha=0.6)
    ax.set_ylim(0.5, 3.0 * max(1, *counted["counts"]))
    ax.axvline(counted["p50"], color=INK, linewidth=0.9)
    ax.axvline(counted["p99"], color=ORANGE, linewidth=0.9, linestyle="--")
    ax.tick_params(axis="x", which="both", top=False)
    ax.tick_params(axis="y", which="minor", left=False, right=False)
    told = " · ".join(
        f"{label} {figure(counted[key])}"
        for label, key in (("p50", "p50"), ("p99", "p99"), ("p99.9", "p99_9"), ("max", "max"))
    )
    ax.set_title(name, loc="left", fontsize=8, pad=2)
    ax.set_title(f"{told} {unit}", loc="right", fontsize=7.5, pad=2, color=GREY)
