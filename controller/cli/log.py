"""``haptic-wall log``: prints the report in a log; exports its rows as CSV or picture."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.drawing import drawn
from haptic_wall.controller.cli.options import (
    answer,
    json_option,
    reading,
    stretch_between,
    stretch_options,
    writing,
)
from haptic_wall.controller.cli.places import FileToWrite, plot_option
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.columns import values
from haptic_wall.controller.logs.reader import LogReader, refusal
from haptic_wall.controller.report.run_text import entry, report_text
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.printable import in_line

_READ_BYTES_S, _WRITTEN_ROWS_S = 5e7, 1.2e5
"""Read bytes, and written rows, per second"""


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@stretch_options
@click.option("--axis", metavar="NAME", help="Of several axes only this one, as if alone.")
@click.option("--csv", "csv_path", type=FileToWrite(), help="Write the rows as CSV to this path.")
@plot_option("Draw the rows as PNG to this path.")
@json_option
def command(
    log: Path,
    start_s: float | None,
    end_s: float | None,
    axis: str | None,
    csv_path: Path | None,
    plot: Path | None,
) -> None:
    """Print the report of LOG, a file that run wrote; on request export its rows, or draw them.

    --from and --to choose the stretch of rows, in seconds since the log's first row.
    """
    with (
        reading("LOG", log, "a log of run"),
        working("reading the log", log.stat().st_size / _READ_BYTES_S),
    ):
        read = LogReader.open(log, stretch_between(start_s, end_s))
        if axis is not None:
            read = read.axis(axis)
        found = _found(read)
    if not found["rows"] and (start_s or end_s or csv_path or plot):
        raise UserError("holds no rows in that stretch", field="LOG", given=log)
    if csv_path is not None:
        from haptic_wall.controller.logs.csv_export import write_csv

        exporting = working(f"writing {csv_path.name}", found["rows"] / _WRITTEN_ROWS_S)
        with exporting, writing("--csv", csv_path), whole(csv_path) as part:
            write_csv(part, read)
    if plot is not None:
        from haptic_wall.controller.report.run import plot_log

        stop_reason = (read.end or {}).get("stop_reason")
        drawn("--plot", plot, partial(plot_log, read, stop_reason=stop_reason))
    try:
        answer(found, lambda: _text(found, log))
    except RecursionError:
        raise refusal(log, "a text in it is nested too deeply") from None


def _found(read: LogReader) -> dict[str, Any]:
    """Return what the log holds; its rows are counted, and checked as they are read."""
    rows, first_s, last_s = 0, math.nan, math.nan
    for block in read.blocks():
        times = values(block[[0, -1]], "time_s", read.origin_ns).tolist()
        first_s, last_s = (times[0] if not rows else first_s), times[1]
        rows += len(block)
    return {
        "program": read.metadata.get("program"),
        "name": read.metadata.get("name"),
        "rows": rows,
        "from_s": first_s,
        "to_s": last_s,
        "metadata": read.metadata,
        "changes": read.changes,
        "report": read.end,
    }


def _text(found: dict[str, Any], log: Path) -> str:
    """Return the lines about the log, and the report of its run.

    Raises:
        LogFormatError: The report is not what a run writes.
    """
    rows = f"{found['rows']} rows"
    if found["rows"]:
        rows += f", from {found['from_s']:.6g} to {found['to_s']:.6g} s"
    name, program = (in_line(str(found[key] or "unknown")) for key in ("name", "program"))
    lines = entry("log", f"{name} ({program}): {rows}")
    if found["report"] is None:
        return "\n".join(
            [*lines, *entry("run", "not ended: it goes on, was killed, or its disk is full")]
        )
    try:
        return "\n".join([*lines, report_text(found["report"] | {"changes": found["changes"]})])
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise refusal(log, "its report is not that of a run") from error
