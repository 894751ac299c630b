"""``haptic-wall log``: summarises a log; exports it as CSV, MCAP or picture; cuts an excerpt."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

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
    writing,
)
from haptic_wall.controller.cli.places import force_option, take_file
from haptic_wall.controller.cli.stretch import stretch_between
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.columns import COLUMNS
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.rows import WHOLE, LogRows
from haptic_wall.controller.logs.summary import summarised
from haptic_wall.controller.system.file_kinds import LOG, PICTURE, Kind, table
from haptic_wall.controller.system.whole_file import whole

_FILE = click.Path(path_type=Path)
_MCAP = Kind(
    "an export of haptic-wall", re.compile(rb"\x89MCAP0\r\n.{0,60}haptic-wall ", re.DOTALL)
)
_KINDS = {
    "--csv": table(",".join([*COLUMNS][:5])),
    "--mcap": _MCAP,
    "--plot": PICTURE,
    "--cut": LOG,
}
_READ_BYTES_S, _WRITTEN_ROWS_S = 4e8, {"--csv": 1.2e5, "--mcap": 5e4, "--cut": 2e6}
"""Read bytes, and written rows, per second"""


@click.command()
@click.argument("log", type=_FILE)
@click.option("--from", "start_s", type=float, metavar="S", help="Start of the stretch [s].")
@click.option("--to", "end_s", type=float, metavar="S", help="End of the stretch [s].")
@click.option("--csv", "csv_path", type=FileToWrite(), help="Write the rows as CSV to this path.")
@click.option("--mcap", "mcap_path", type=_FILE, help="Write the rows as MCAP to this path.")
@click.option("--plot", type=FileToWrite(), help="Draw the rows as PNG to this path.")
@click.option("--cut", "cut_path", type=_FILE, help="Write the stretch as a new log to this path.")
@force_option
@json_option
def command(
    log: Path,
    start_s: float | None,
    end_s: float | None,
    csv_path: Path | None,
    mcap_path: Path | None,
    plot: Path | None,
    cut_path: Path | None,
    force: bool,
    as_json_wanted: bool,
) -> None:
    """Summarise LOG, a file that run wrote; on request export it, draw it, or cut a stretch out.

    --from and --to choose the stretch, in seconds since the log's first row, for the summary and
    all written files. Damaged parts are left out and reported.
    """
    wanted: dict[str, Path | None] = {
        "--csv": csv_path,
        "--mcap": mcap_path,
        "--plot": plot,
        "--cut": cut_path,
    }
    refuse_same_file({"LOG": log, **wanted})
    if plot is not None:
        refuse_other_pictures("--plot", plot)
    for option, path in (("--mcap", mcap_path), ("--cut", cut_path)):
        if path is not None and path.exists() and not path.is_file() and not path.is_dir():
            raise UserError(
                "found a pipe or a device",
                field=option,
                given=path,
                wanted="a file: this format is not written in sequence",
                advice="only --csv can go to a pipe or a device",
            )
    for option, path in wanted.items():
        if path is not None:
            take_file(option, path, _KINDS[option], force=force)
    stretch = stretch_between(start_s, end_s)
    if cut_path is not None and start_s is None and end_s is None:
        raise UserError(
            "found neither --from nor --to", field="--cut", advice="give the stretch in seconds"
        )
    with (
        reading("LOG", log, "a log of run"),
        working("reading the log", log.stat().st_size / _READ_BYTES_S),
    ):
        rows = LogRows.of(LogReader(log), stretch)
        summary = summarised(rows)
    report = summary.report(rows.origin_ns)
    if not summary.rows:
        _refuse_nothing(log, rows, any(wanted.values()))
    metadata = summary.parts[0].metadata
    if len(summary.parts) > 1:
        _refuse_joined(log, report, wanted)
    _write(replace(rows, metadata=metadata), wanted, log, report, force=force)
    facts = {"program": metadata.get("program"), "name": metadata.get("name")}
    full = {**facts, **report, "config": config_line(metadata.get("config"))}
    if as_json_wanted:
        answer(as_json({**full, "cut": metadata.get("cut"), "metadata": metadata}))
    else:
        answer(summary_text(full, metadata.get("cut"), log.name))


def _refuse_nothing(log: Path, rows: LogRows, export: bool) -> None:
    """Refuse an empty stretch, and an export without rows."""
    whole_log = summarised(replace(rows, stretch=WHOLE)).report(rows.origin_ns)
    if whole_log["rows"]:
        raise UserError(
            "holds no rows in that stretch",
            field="LOG",
            given=log,
            advice=f"its rows are from 0 to {whole_log['to_s']:.6g} s",
        )
    if export:
        raise UserError("holds no rows, so there is nothing to export", field="LOG", given=log)


def _refuse_joined(log: Path, report: dict[str, Any], wanted: dict[str, Path | None]) -> None:
    """Refuse exports of a single log where the stretch has rows of several."""
    for option, path in wanted.items():
        if path is not None and option != "--csv":
            spans = ", ".join(
                f"{part['from_s']:.6g} to {part['to_s']:.6g} s"
                for part in report["parts"]
                if part["rows"]
            )
            raise UserError(
                f"LOG {log} is {len(report['parts'])} logs joined in one file",
                field=option,
                advice=f"choose one of them by --from and --to: {spans}",
            )


def _write(
    rows: LogRows, wanted: dict[str, Path | None], log: Path, report: dict[str, Any], *, force: bool
) -> None:
    """Write the requested files; each is complete or absent."""

    def csv(path: Path) -> None:
        from haptic_wall.controller.logs.csv_export import write_csv

        write_csv(path, rows)

    def mcap(path: Path) -> None:
        from haptic_wall.controller.logs.mcap_export import write_mcap

        write_mcap(path, rows)

    def picture(path: Path) -> None:
        from haptic_wall.controller.report.run import plot_log

        plot_log(rows, path, report["stop_reason"])

    def cut(path: Path) -> None:
        from haptic_wall.controller.logs.excerpt import write_excerpt

        write_excerpt(path, rows, log.name, report["from_s"], report["to_s"])

    writers: dict[str, Callable[[Path], None]] = {
        "--csv": csv,
        "--mcap": mcap,
        "--plot": picture,
        "--cut": cut,
    }
    for option, path in wanted.items():
        if path is not None:
            if option == "--plot":
                drawn(option, path, writers[option], force=force)
                continue
            about_s = report["rows"] / _WRITTEN_ROWS_S[option]
            shown = working(f"writing {path.name}", about_s)
            with shown, writing(option, path), whole(path, _KINDS[option], force=force) as part:
                writers[option](part)
