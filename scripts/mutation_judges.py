"""Judges whether a program read from a file what is in it, and told what it left out."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from haptic_wall.controller.logs.columns import COLUMNS
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from scripts.mutated_logs import Key, Log
from scripts.mutated_texts import NUMBER, Table

_STEP_S = 1e-3
"""Between rows of a log that was made here"""


def of_log(
    log: Log, summary: dict[str, Any], csv: Path, detected: dict[str, Any] | None
) -> tuple[str, str]:
    """Judge whether all rows that were read were written, and missing ones were reported.

    Args:
        log: The log that was read.
        summary: Answer of ``log --json``.
        csv: The exported file.
        detected: Answer of ``detect --json``; None: it has refused the log.

    Returns:
        ``read`` or ``told``, and the faults that were not reported; empty: none.
    """
    lines = csv.read_text("utf-8").splitlines()[1:]
    cells = [line.split(",") for line in lines]
    times = [float(row[0]) for row in cells]
    read: list[Key] = [tuple(float(x) if x else None for x in row[1:]) for row in cells]
    said = bool(
        summary["damaged"]["places"]
        or any(summary["misplaced_rows"].values())
        or summary["unrecorded_rows"]
        or len(summary["parts"]) > 1
    )
    wrong = []
    if summary["rows"] != len(read):
        wrong.append(f"{summary['rows']} rows are summarised, {len(read)} exported")
    if any(b <= a for a, b in pairwise(times)):
        wrong.append("time does not increase")
    if not set(read) <= {row for truth in log.written for row in truth}:
        wrong.append("rows that were never written")
    at = 0
    for part in summary["parts"]:
        rows = read[at : at + part["rows"]]
        places = next(filter(None, (_places(rows, truth) for truth in log.written)), None)
        if places is None and rows and not said:
            wrong.append("rows of several logs, or in another order, without a word")
        elif log.even and places:
            spans = [times[at + k] - times[at] for k in range(len(rows))]
            steps = [_STEP_S * (place - places[0]) for place in places]
            if any(abs(a - b) > 1e-9 for a, b in zip(spans, steps, strict=True)):
                wrong.append("rows at another time than they were written")
        at += part["rows"]
    first = log.written[0]
    ended = summary["stop_reason"] is not None
    whole = read == first or (not ended and read == first[: len(read)])
    if not whole and not said:
        wrong.append(f"{len(read)} rows of {len(first)} without a word")
    if detected is not None:
        wrong += _disagreement(cells, detected)
    return "told" if said else "read", "; ".join(wrong)


def _places(rows: list[Key], truth: list[Key]) -> list[int] | None:
    """Where these rows stand among others, in their order; None: not all do."""
    places, at = [], 0
    for row in rows:
        while at < len(truth) and truth[at] != row:
            at += 1
        if at == len(truth):
            return None
        places.append(at)
        at += 1
    return places


def _disagreement(cells: list[list[str]], report: dict[str, Any]) -> Iterator[str]:
    """Where ``detect`` has looked at other rows than ``log`` has exported."""
    flags = list(COLUMNS).index("flags")
    on = [row for row in cells if not int(row[flags]) & FLAG_WARM_UP]
    short = any("too few" in note or "too short" in note for note in report["notes"])
    short = short or any("readings failed" in note for note in report["notes"])
    if report["samples"] > len(on) or (not short and report["samples"] != len(on)):
        yield f"detect looked at {report['samples']} samples, log exported {len(on)}"


def of_configuration(text: str, report: dict[str, Any]) -> str:
    """Numbers in force that are not those in the file, by another reader; empty: none."""
    held = yaml.load(text, yaml.BaseLoader)
    if not isinstance(held, dict) or "<<" in text:
        return ""
    for section, keys in held.items():
        for key, value in keys.items() if isinstance(keys, dict) else ():
            found = report["fields"].get(f"{section}.{key}")
            if found is None or not isinstance(value, str) or not NUMBER.fullmatch(value):
                continue
            if found["value"] != float(value):
                return f"{section}.{key}: {value} became {found['value']}"
    return ""


def of_csv(path: Path, table: Table | None, report: dict[str, Any]) -> tuple[str, str]:
    """Whether all rows were looked at, or what was not was told; as ``of_log``."""
    notes = [note for note in report["notes"] if "no column" not in note]
    outcome, samples = "told" if notes else "read", report["samples"]
    if table is None:
        with path.open(encoding="utf-8-sig", errors="replace") as file:  # any line end
            rows = sum(bool(line.strip()) for line in file) - 1
        wrong = not notes and samples != rows
        return outcome, f"{samples} samples of {rows} rows without a word" if wrong else ""
    if abs(samples - table.rows) > 0.02 * table.rows:
        return outcome, f"{samples} samples of {table.rows} rows"
    if not abs(report["period_s"] / table.periods[0] - 1.0) < 0.1:
        return outcome, f"a period of {report['period_s']} s, not {table.periods[0]}"
    return outcome, ""
