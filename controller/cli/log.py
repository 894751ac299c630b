"""``haptic-wall log``: what a log holds; export as CSV."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from controller.cli.options import (
    answer,
    as_json,
    json_option,
    refuse_other_pictures,
    refuse_same_file,
    writing,
)
from controller.errors import UserError
from controller.logfile import read_log
from hw.servo import Outcome

_COLUMNS = {
    "time_s": "deadline_ns",
    "position_rad": "position",
    "torque_nm": "torque",
    "velocity_rad_s": "velocity",
    "wall_torque_nm": "wall_torque",
    "stiffness_nm_per_rad": "stiffness",
    "damping_nms_per_rad": "damping",
    "delay_s": "delay_s",
    "outcome": "outcome",
    "missed_ticks": "missed",
    "lateness_us": "lateness_ns",
    "work_us": "work_ns",
    "bus_us": "bus_ns",
    "sample_age_us": "age_ns",
    "flags": "flags",
    "phase": "phase",
    "oscillation": "oscillation",
    "measured_torque_nm": "measured_torque",
}
"""Columns of the CSV and the fields of a row they come from."""


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--csv", "csv_path", type=click.Path(path_type=Path), help="Write all rows there as CSV."
)
@click.option("--plot", type=click.Path(path_type=Path), help="Draw the run there as PNG.")
@json_option
def command(log: Path, csv_path: Path | None, plot: Path | None, as_json_wanted: bool) -> None:
    """Summarise LOG, a file written by run; on request as CSV or as a picture."""
    refuse_same_file({"LOG": log, "--csv": csv_path, "--plot": plot})
    if plot is not None:
        refuse_other_pictures("--plot", plot)
    try:
        metadata, rows = read_log(log)
    except OSError as error:
        raise UserError(
            f"LOG {log}: cannot be read: {error.strerror}; wanted a log of run"
        ) from None
    if (csv_path or plot) and not len(rows):
        raise UserError(f"LOG {log}: holds no rows, so there is nothing to export")
    if csv_path is not None:
        with writing("--csv", csv_path):
            _write_csv(csv_path, rows)
    if plot is not None:
        from controller.plot import plot_run

        with writing("--plot", plot):
            plot_run(rows, metadata, plot)
    summary = _summary(metadata, rows)
    answer(as_json({**summary, "metadata": metadata}) if as_json_wanted else _text(summary))


def _summary(metadata: dict[str, Any], rows: NDArray[np.void]) -> dict[str, Any]:
    config = metadata.get("config", {})
    servo, wall = config.get("servo", {}), config.get("wall", {})
    summary: dict[str, Any] = {
        "program": metadata.get("program"),
        "name": metadata.get("name"),
        "rows": len(rows),
        "duration_s": None,
        "rate_hz": None,
        "missed_ticks": None,
        "failed_readings": None,
        "unrecorded_rows": None,
        "position_rad": None,
        "torque_nm": None,
        "config": f"{servo.get('backend', 'unknown')} servo, wall {wall.get('side', 'unknown')} "
        f"{wall.get('position', 'unknown')} rad, K {wall.get('stiffness', 'unknown')} N·m/rad, "
        f"B {wall.get('damping', 'unknown')} N·m·s/rad asked, "
        f"{config.get('loop', {}).get('rate_hz', 'unknown')} Hz",
    }
    if not len(rows):
        return summary
    elapsed = float(rows["deadline_ns"][-1] - rows["deadline_ns"][0]) * 1e-9
    good = rows["position"][np.isfinite(rows["position"])]
    return summary | {
        "duration_s": elapsed,
        "rate_hz": (len(rows) - 1) / elapsed if elapsed else None,
        "missed_ticks": int(rows["missed"].sum()),
        "failed_readings": int((~np.isin(rows["outcome"], (Outcome.OK, Outcome.WAITING))).sum()),
        "unrecorded_rows": int(rows["seq"][-1]) + 1 - len(rows),
        "position_rad": [float(good.min()), float(good.max())] if len(good) else None,
        "torque_nm": [float(rows["torque"].min()), float(rows["torque"].max())],
    }


def _text(summary: dict[str, Any]) -> str:
    def span(key: str) -> str:
        return "unknown" if summary[key] is None else "{:.4g} to {:.4g}".format(*summary[key])

    lines = [
        f"run         {summary['name']} ({summary['program']})",
        f"config      {summary['config']}",
    ]
    if not summary["rows"]:
        return "\n".join([*lines, "rows        none"])
    rate = "unknown" if summary["rate_hz"] is None else f"{summary['rate_hz']:.6g} Hz"
    return "\n".join(
        [
            *lines,
            f"rows        {summary['rows']} in {summary['duration_s']:.6g} s: {rate}",
            f"lost        {summary['missed_ticks']} missed ticks, {summary['failed_readings']} "
            f"failed readings, {summary['unrecorded_rows']} rows not recorded",
            f"position    {span('position_rad')} rad",
            f"torque      {span('torque_nm')} N·m",
        ]
    )


def _write_csv(path: Path, rows: NDArray[np.void]) -> None:
    """All rows as text that reads back exactly; time starts at 0, NaN is an empty cell."""
    columns = []
    for column, field in _COLUMNS.items():
        values = rows[field]
        if column == "time_s":
            values = (values - values[0]) / 1e9
        elif column.endswith("_us"):
            values = values / 1e3
        if values.dtype.kind == "f":
            columns.append(["" if text == "nan" else text for text in map(repr, values.tolist())])
        else:
            columns.append(list(map(str, values.tolist())))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_COLUMNS)
        writer.writerows(zip(*columns, strict=True))
