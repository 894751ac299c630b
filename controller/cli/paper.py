"""``haptic-wall paper``: reproduces the paper's table and figures, as CSV and PNG."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.options import answer, json_option, say, writing
from haptic_wall.controller.cli.places import force_option, take_folder
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.paper.items import ITEMS

if TYPE_CHECKING:
    from haptic_wall.controller.paper.items import Made

_NAMES = list(ITEMS)
_ALL = "all"
_ITEM_S = 2.0
"""Approximate duration of an item [s]"""


@click.command()
@click.argument("item", metavar="[ITEM]", default=_ALL, type=click.Choice([*_NAMES, _ALL]))
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR", required=True, help="Folder for files."
)
@force_option
@json_option
def command(item: str, out: Path) -> None:
    """Reproduce the paper's results: CSV and PNG of ITEM, one of table2, fig3, fig4, fig5, fig6,
    fig8, fig9, fig10 or all (the default).

    Source: Gil et al., "Stability Boundary for Haptic Rendering: Influence of Damping and Delay",
    ICRA 2007.
    """  # noqa: D205 - the first paragraph is the help's summary
    from haptic_wall.controller.paper.items import make

    wanted = _NAMES if item == _ALL else [item]
    files = [f"{name}{end}" for name in wanted for end in (".csv", ".png")]
    take_folder("--out", out, files)
    made = []
    with working("computing", _ITEM_S * len(wanted)), writing("--out", out):
        for name in wanted:
            say(f"{name} ...")
            made.append(make(name, out))
    paths = [path for entry in made for path in (entry.csv, entry.png)]
    answer(_report(made, paths), lambda: _text(made, paths))


def _report(made: list[Made], files: list[Path]) -> dict[str, Any]:
    from haptic_wall.controller.paper.table2 import SOURCES

    table = next((entry.table for entry in made if entry.table is not None), None)
    worst = table and {source: table.worst(source) for source in SOURCES}
    return {"files": files, "table2": worst}


def _text(made: list[Made], files: list[Path]) -> str:
    from haptic_wall.controller.paper.table2 import text, worst_text

    lines = []
    for entry in made:
        if entry.table is not None:
            lines = [*(worst_text(entry.table) if len(made) > 1 else [text(entry.table)]), ""]
    lines += ["written"]
    return "\n".join([*lines, *(f"  {path}" for path in files)])
