"""Lists the paper's results by name, with the functions that make their files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from haptic_wall.controller.paper import boundaries, linear_error, lwr3, table2
from haptic_wall.controller.paper.curves import FigureData, write_csv
from haptic_wall.controller.system.files import whole

TABLE2 = "table2"
FIGURES: dict[str, tuple[Callable[[], FigureData], Callable[[FigureData, Path], None]]] = {
    "fig3": (boundaries.figure_3, boundaries.draw_figure_3),
    "fig4": (boundaries.figure_4, boundaries.draw_figure_4),
    "fig5": (boundaries.figure_5, boundaries.draw_figure_5),
    "fig6": (boundaries.figure_6, boundaries.draw_figure_6),
    "fig8": (lwr3.figure_8, lwr3.draw_figure_8),
    "fig9": (lwr3.figure_9, lwr3.draw_figure_9),
    "fig10": (linear_error.figure_10, linear_error.draw_figure_10),
}
"""The figures: what computes one, and what draws it"""
ITEMS = (TABLE2, *FIGURES)
"""In the paper's order, as on the command line; also the names of their files"""


@dataclass(frozen=True, slots=True)
class Made:
    """An item's files."""

    csv: Path
    png: Path
    table: table2.Table2 | None
    """Of Table II only"""


def make(name: str, folder: Path) -> Made:
    """Compute an item and write its CSV and PNG.

    Args:
        name: One of ``ITEMS``.
        folder: Existing folder for the files.

    Raises:
        KeyError: There is no such item.
        OSError: A file cannot be written.
    """
    csv, png = folder / f"{name}.csv", folder / f"{name}.png"
    table = table2.compare() if name == TABLE2 else None
    if table is not None:
        with whole(csv) as csv_part, whole(png) as png_part:
            table2.write_csv(table, csv_part)
            table2.draw(table, png_part)
        return Made(csv, png, table)
    compute, draw = FIGURES[name]
    data = compute()
    with whole(csv) as csv_part, whole(png) as png_part:
        write_csv(data, csv_part)
        draw(data, png_part)
    return Made(csv, png, None)
