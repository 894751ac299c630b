"""``haptic-wall log``: summarises a log; exports it as CSV or picture."""

from __future__ import annotations

from pathlib import Path

import click

from haptic_wall.controller.cli.drawing import drawn
from haptic_wall.controller.cli.log_text import config_line, summary_text
from haptic_wall.controller.cli.options import (
    FileToWrite,
    answer,
    as_json,
    json_option,
    reading,
    refuse_other_pictures,
    refuse_same_file,
    stretch_between,
    stretch_options,
    writing,
)
from haptic_wall.controller.cli.places import force_option, take_file
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.reader import LogReader, TimeSpan
from haptic_wall.controller.logs.summary import summarised
from haptic_wall.controller.system.files import whole

_READ_BYTES_S, _WRITTEN_ROWS_S = 5e7, 1.2e5
"""Read bytes, and written rows, per second"""


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@stretch_options
@click.option("--csv", "csv_path", type=FileToWrite(), help="Write the rows as CSV to this path.")
@click.option("--plot", type=FileToWrite(), help="Draw the rows as PNG to this path.")
@force_option
@json_option
def command(
    log: Path,
    start_s: float | None,
    end_s: float | None,
    csv_path: Path | None,
    plot: Path | None,
    force: bool,
    as_json_wanted: bool,
) -> None:
    """Summarise LOG, a file that run wrote; on request export its rows, or draw them.

    --from and --to choose the stretch, in seconds since the log's first row, for the summary and
    all written files.
    """
    refuse_same_file({"LOG": log, "--csv": csv_path, "--plot": plot})
    if csv_path is not None:
        take_file("--csv", csv_path, force=force)
    if plot is not None:
        refuse_other_pictures("--plot", plot)
        take_file("--plot", plot, force=force)
    with (
        reading("LOG", log, "a log of run"),
        working("reading the log", log.stat().st_size / _READ_BYTES_S),
    ):
        read = LogReader.open(log, TimeSpan(*stretch_between(start_s, end_s)))
        summary = summarised(read)
    if not summary["rows"] and (start_s or end_s or csv_path or plot):
        raise UserError("holds no rows in that stretch", field="LOG", given=log)
    if csv_path is not None:
        from haptic_wall.controller.logs.csv_export import write_csv

        exporting = working(f"writing {csv_path.name}", summary["rows"] / _WRITTEN_ROWS_S)
        with exporting, writing("--csv", csv_path), whole(csv_path) as part:
            write_csv(part, read)
    if plot is not None:
        from haptic_wall.controller.report.run import plot_log

        def draw(path: Path) -> None:
            plot_log(read, path, summary["stop_reason"])

        drawn("--plot", plot, draw)
    facts = {"program": read.metadata.get("program"), "name": read.metadata.get("name")}
    full = {**facts, **summary, "config": config_line(read.metadata.get("config"))}
    if as_json_wanted:
        answer(as_json({**full, "metadata": read.metadata}))
    else:
        answer(summary_text(full, log.name))
