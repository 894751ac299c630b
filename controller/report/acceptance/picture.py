"""Draws an acceptance: each predicted range, with the real and the emulated servo in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.report import style

_ROW = 0.24
"""Height of a row [inch]"""
_ERRORS = 2.0


def plot_acceptance(rows: Sequence[Mapping[str, Any]], name: str, path: Path) -> None:
    """Draw every row with a prediction, scaled to the middle of its bounds.

    Args:
        rows: As in the report.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    shown = [row for row in rows if row["high"]]
    with style.picture(path, style.PAGE, 1.2 + _ROW * max(len(shown), 1)) as figure:
        figure.suptitle(
            f"{style.titled(name)}: measured over the middle of the prediction",
            fontsize=9,
            ha="left",
            x=0.01,
        )
        ax = figure.subplots()
        places = np.arange(len(shown))
        for place, row in zip(places, shown, strict=True):
            middle = 0.5 * (row["low"] + row["high"])
            low, high = row["low"] / middle, row["high"] / middle
            ax.barh(
                place,
                high - low,
                left=low,
                height=0.7,
                color=style.FAINT,
                edgecolor=style.GREY,
                lw=0.4,
            )
            for key, colour, mark, off in (
                ("real", style.BLUE, "o", -0.14),
                ("emulated", style.ORANGE, "s", 0.14),
            ):
                found = row[key]
                if found is None:
                    continue
                error = _ERRORS * (found["stderr"] or 0.0) / middle
                ax.errorbar(
                    [found["value"] / middle],
                    [place + off],
                    xerr=[error],
                    color=colour,
                    marker=mark,
                    markersize=3.5,
                    linestyle=" ",
                    capsize=2.0,
                    elinewidth=0.8,
                )
        ax.set_yticks(places, [_label(row) for row in shown], fontsize=6.5, linespacing=0.95)
        ax.invert_yaxis()
        ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
        ax.set_xlabel("1 is the middle of the predicted range (grey)")
        style.grid(ax)
        figure.legend(handles=_legend(), loc="outside upper right", ncols=2, fontsize=7)


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D

    look: dict[str, Any] = {"linestyle": " ", "markersize": 4}
    return [
        Line2D([], [], color=style.BLUE, marker="o", label="this servo, ±2 s.e.", **look),
        Line2D(
            [], [], color=style.ORANGE, marker="s", label="emulated as believed, ±2 s.e.", **look
        ),
    ]


def _label(row: Mapping[str, Any]) -> str:
    """Return a row's name; a limit's with the kicks for which it was measured."""
    kicks = [
        f"{row[key]['kick_rad']:.3g} rad{of}"
        for key, of in (("real", ""), ("emulated", ", emulated"))
        if row[key] is not None and row[key]["kick_rad"]
    ]
    return f"{row['name']}\n(kick {'; '.join(kicks)})" if kicks else str(row["name"])
