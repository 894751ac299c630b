"""``haptic-wall rendered``: stiffness, drag and contacts as rendered, against what is commanded."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import (
    ask_to_move,
    endings,
    folder_for,
    keep,
    moving,
    yes_option,
)
from haptic_wall.controller.cli.options import (
    answer,
    as_json,
    config_argument,
    json_option,
    say,
    set_option,
)
from haptic_wall.controller.cli.places import force_option
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.system.file_kinds import RESULT_MARK

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.rendered.rendering import Rendering


@click.command()
@config_argument()
@set_option
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of all that is random.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Where rendered.json, rendered.png and the logs go; default: a folder in ./runs/.",
)
@yes_option
@force_option
@json_option
def command(
    config: str,
    sets: tuple[str, ...],
    seed: int,
    out: Path | None,
    yes: bool,
    force: bool,
    as_json_wanted: bool,
) -> None:
    """Measure what CONFIG's servo renders: is the commanded stiffness that of the wall?

    The wall that a run would command is pushed as a spring, the free shaft is moved at several
    speeds, and the wall is struck. The shaft moves by up to half a radian either way.
    """
    from haptic_wall.controller.experiments.rendered.rendering import (
        SECONDS,
        measure_rendering,
        rendering_report,
    )

    loaded = load_config(config, sets)
    folder = folder_for(out, "rendered", force=force)
    ask_to_move(loaded.config.servo, yes)
    with moving(loaded.config, SECONDS), endings():
        found = measure_rendering(loaded.config, folder, seed, say)
    from haptic_wall.controller.report.rendered import plot_rendering

    files = [folder / "rendered.json", folder / "rendered.png"]
    report = {**RESULT_MARK, "name": loaded.name, **rendering_report(found), "files": files}
    keep(folder, "rendered", report, partial(plot_rendering, found, loaded.name), force=force)
    answer(as_json(report) if as_json_wanted else _text(found, files))


def _text(found: Rendering, files: list[Path]) -> str:
    """The comparison as a table, and where the rest is."""
    lines = [
        f"{'':<32}{'commanded':>12}{'rendered':>12}{'± stderr':>12}{'ratio':>8}",
    ]
    for row in found.rows:
        unit = "" if row.unit == "1" else f" [{row.unit}]"
        cells = _cell(row.commanded) + _cell(row.rendered) + _cell(row.stderr, 2)
        lines.append(
            f"{row.name + unit:<32}{cells}"
            + (f"{row.ratio:>8.3f}" if row.ratio is not None else f"{'':>8}")
            + (f"  {row.note}" if row.note else "")
        )
    if found.binding is not None:
        lines.append(
            f"{found.requested.stiffness:g} N·m/rad were asked for; the guard commands"
            f" {found.stiffness:.4g} ({found.binding} limit)"
        )
    return "\n".join([*lines, *found.notes, "", "written", *(f"  {path}" for path in files)])


def _cell(value: float | None, digits: int = 4) -> str:
    return f"{'-':>12}" if value is None else f"{value:>12.{digits}g}"
