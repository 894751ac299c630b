"""``haptic-wall paper``: reproduces the paper's table and figures, as CSV and PNG."""

from __future__ import annotations

from pathlib import Path

import click

from haptic_wall.controller.cli.options import answer, json_option, say, writing, written
from haptic_wall.controller.cli.places import force_option, take_folder
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.paper import table2
from haptic_wall.controller.paper.items import ITEMS, TABLE2, make

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
    wanted = _NAMES if item == _ALL else [item]
    files = [f"{name}{end}" for name in wanted for end in (".csv", ".png")]
    take_folder("--out", out, files)
    made = {}
    with working("computing", _ITEM_S * len(wanted)), writing("--out", out):
        for name in wanted:
            say(f"{name} ...")
            made[name] = make(name, out / f"{name}.csv", out / f"{name}.png")
    table, paths = made.get(TABLE2), [out / file for file in files]
    worst = table and {source: table.worst(source) for source in table2.SOURCES}
    answer({"files": paths, "table2": worst}, lambda: _text(table, len(made) > 1, paths))


def _text(table: table2.Table2 | None, briefly: bool, files: list[Path]) -> str:
    lines = []
    if table is not None:
        lines = [*(table2.worst_text(table) if briefly else [table2.text(table)]), ""]
    return "\n".join([*lines, *written(files)])
