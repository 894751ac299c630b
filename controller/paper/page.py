"""Writes the index page: every picture with its caption and numbers, and links to the CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from haptic_wall import __version__
from haptic_wall.controller.paper.items import Made
from haptic_wall.controller.paper.table2 import worst_text
from haptic_wall.controller.report.html import filled_in
from haptic_wall.controller.system.files import whole

PAGE = "index.html"


def write_page(made: Sequence[Made], folder: Path) -> Path:
    """Write the page beside the files that it shows.

    Args:
        made: The items in order; their files are in ``folder``.
        folder: Folder of the page.

    Returns:
        Its path.

    Raises:
        OSError: It cannot be written.
    """
    worst = {m.item.name: worst_text(m.table) for m in made if m.table is not None}
    page = folder / PAGE
    text = filled_in(__package__, made=made, worst=worst, version=__version__)
    with whole(page) as part:
        part.write_text(text, encoding="utf-8")
    return page
