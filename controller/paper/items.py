"""Lists the paper's results by name, with the functions that make their files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from haptic_wall.controller.paper import boundaries, curves, linear_error, lwr3, table2
from haptic_wall.controller.system.files import whole

TABLE2 = "table2"


class Item(NamedTuple):
    """One of the paper's results."""

    compute: Callable[[], Any]
    draw: Callable[[Any, Path], None]
    write_csv: Callable[[Any, Path], None] = curves.write_csv


ITEMS = {
    TABLE2: Item(table2.compare, table2.draw, table2.write_csv),
    "fig3": Item(boundaries.figure_3, boundaries.draw_figure_3),
    "fig4": Item(boundaries.figure_4, boundaries.draw_figure_4),
    "fig5": Item(boundaries.figure_5, boundaries.draw_figure_5),
    "fig6": Item(boundaries.figure_6, boundaries.draw_figure_6),
    "fig8": Item(lwr3.figure_8, lwr3.draw_figure_8),
    "fig9": Item(lwr3.figure_9, lwr3.draw_figure_9),
    "fig10": Item(linear_error.figure_10, linear_error.draw_figure_10),
}
"""In the paper's order, as on the command line; also the names of their files"""


def make(name: str, csv: Path, png: Path) -> Any:  # noqa: ANN401 - each item has its own data
    """Compute an item and write its CSV and PNG; return its data.

    Args:
        name: One of ``ITEMS``.
        csv: Path of the CSV.
        png: Path of the PNG.

    Raises:
        OSError: A file cannot be written.
    """
    item = ITEMS[name]
    data = item.compute()
    with whole(csv) as csv_part, whole(png) as png_part:
        item.write_csv(data, csv_part)
        item.draw(data, png_part)
    return data
