"""Runs some 90 short simulated walls, and lists those whose rows differ from before.

    scripts/study same_rows [--write] [--keep FOLDER] [--against FOLDER] [--only NAME ...]

A restructuring changes no number: not one bit of any row. tests/same_rows.txt holds a line for each
run: its rows, its stop reason, its exit status, and digests of its rows and of the report's
figures. The script calls the command, and reads its answers and the logged rows only,
so it works whatever the modules are called.

An exact digest holds on machines with the same processor and the same versions of Python, NumPy,
SciPy and the C library; the first line of the file names them. Elsewhere a sine, a logarithm or an
eigenvalue may differ in the last bits, and so may the commanded stiffness. There the second digest
counts, of the same figures rounded to 6 significant digits; below 1e-12 they count as 0. More
digits would not be safe: a figure at the edge between two roundings goes either way, and a run has
some 10,000 figures.
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import hashlib
import importlib.metadata
import io
import json
import os
import platform
import signal
import sqlite3
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_wall.controller.cli.main import main as main_command
from scripts.same_rows_cases import CASES, Case

ROOT = Path(__file__).resolve().parent.parent
DIGESTS = ROOT / "tests" / "same_rows.txt"
KEPT = ROOT / "runs" / "same-rows"
"""Rows as they were when the digests were last written on this machine"""
DIGITS = 6
"""Significant digits of the rounded digests"""
SMALLEST = 1e-12
"""Smaller figures are rounded to 0"""
_PLAIN = ("ticks", "duration_s", "missed_ticks", "rate_hz", "grid_hz", "stop_reason")
_WHOLE = ("lateness_us", "work_us", "bus_us", "bus", "delay_s", "torque", "wall_came_on")
_PARTS = {
    "guard": "requested commanded damping_ceiling margin binding only_friction interval_s",
    "oscillation": "state frequency_hz amplitude_rad first_alarm_s",
}
_LIMITS = ("linear", "exact", "one_sided", "quantisation", "passive")
Rows = Mapping[str, list[str]]
"""Columns by name, with their figures as text"""


@dataclass(frozen=True, slots=True)
class Ran:
    """One run of the command."""

    rows: Rows
    stop: str
    """Stop reason; empty where the run was refused"""
    status: int
    report: str
    """Figures of the report, as JSON"""


@dataclass(frozen=True, slots=True)
class Line:
    """A run's line in the file of digests."""

    name: str
    rows: int
    stop: str
    status: int
    exact: str
    """First 16 digits of the SHA-256 of the rows"""
    rounded: str
    report: str
    """As ``exact``, of the report's figures"""
    report_rounded: str

    def __str__(self) -> str:
        digests = (self.exact, self.rounded, self.report, self.report_rounded)
        return " ".join((self.name, str(self.rows), self.stop, str(self.status), *digests))

    def coarse(self) -> tuple[object, ...]:
        """Parts that hold on every machine."""
        return self.name, self.rows, self.stop, self.status, self.rounded, self.report_rounded


def command(*arguments: str) -> tuple[int, str]:
    """Run ``haptic-wall`` in this process; its exit status and standard output."""
    told, interrupt = io.StringIO(), signal.getsignal(signal.SIGINT)
    status: object = 0
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(io.StringIO()):
            status = main_command(list(arguments))
    except SystemExit as ended:
        status = ended.code
    finally:
        signal.signal(signal.SIGINT, interrupt)
    return (status if isinstance(status, int) else 0), told.getvalue()


def ran(case: Case) -> Ran:
    """Run one case on the simulated clock; its rows and what it reports."""
    sets = [word for one in ("loop.clock=simulated", *case.sets) for word in ("--set", one)]
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "run.hwlog")
        places = ["--duration", str(case.seconds), "--log", str(log), "--no-plot", "--json"]
        status, told = command("run", case.preset, *sets, *places)
        rows: Rows = {}
        if log.exists():
            with contextlib.closing(sqlite3.connect(log)) as opened:
                found = opened.execute("SELECT * FROM rows ORDER BY seq")
                columns = zip(*found.fetchall(), strict=True)
                rows = {
                    name: [*map(_figure, column)]
                    for (name, *_), column in zip(found.description, columns, strict=False)
                }
    answer = json.loads(told)
    return Ran(rows, answer.get("stop_reason", "-"), status, json.dumps(_figures(answer)))


def _figure(value: float | None) -> str:
    return "" if value is None else repr(value)


def _figures(report: Mapping[str, Any]) -> dict[str, Any]:
    """Figures that the report promises; no sentences."""
    figures = {name: report[name] for name in (*_PLAIN, *_WHOLE) if name in report}
    for part, names in _PARTS.items():
        found = report.get(part) or {}
        figures |= {f"{part}.{name}": found.get(name) for name in names.split()}
    limits = (report.get("guard") or {}).get("limit") or {}
    return figures | {f"limit.{name}": limits.get(name) for name in _LIMITS}


def line_of(name: str, found: Ran) -> Line:
    """The line of a run in the file of digests."""
    rows = [[column, *found.rows[column]] for column in sorted(found.rows)]
    report = [[name, *_leaves(value)] for name, value in json.loads(found.report).items()]
    count = len(next(iter(found.rows.values()), ()))
    digests = [_digest(part, rounds) for part in (rows, report) for rounds in (False, True)]
    return Line(name, count, found.stop, found.status, *digests)


def _leaves(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        for name in sorted(value):
            yield name
            yield from _leaves(value[name])
    else:
        yield json.dumps(value)


def _digest(parts: Iterable[list[str]], rounds: bool) -> str:
    total = hashlib.sha256()
    for part in parts:
        texts = map(rounded, part) if rounds else part
        total.update("\n".join(texts).encode() + b"\n\n")
    return total.hexdigest()[:16]


def rounded(text: str) -> str:
    """A figure with as many digits as hold on every machine; another text as it is."""
    try:
        value = float(text)
    except ValueError:
        return text
    if abs(value) < SMALLEST:
        value = 0.0
    return f"{value:.{DIGITS - 1}e}"


def machine() -> str:
    """Processor and versions that exact digests depend on, as one line."""
    found: dict[str, str] = {}
    with contextlib.suppress(OSError):
        for text in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            key, _, value = text.partition(":")
            found.setdefault(key.strip(), value.strip())
    flags = [flag for flag in ("fma", "avx2", "avx512f") if flag in found.get("flags", "").split()]
    cpu = "/".join(found.get(key, "?") for key in ("vendor_id", "cpu family", "model"))
    versions = [f"{name} {importlib.metadata.version(name)}" for name in ("numpy", "scipy")]
    python = f"python {platform.python_version()}"
    return ", ".join((cpu, *flags, " ".join(platform.libc_ver()), python, *versions))


def lines_in(text: str) -> tuple[str, dict[str, Line]]:
    """The machine on which a file of digests was written, and its lines by name."""
    first, *rest = text.splitlines()
    lines = {}
    for line in rest:
        name, rows, stop, status, *digests = line.split()
        lines[name] = Line(name, int(rows), stop, int(status), *digests)
    return first.removeprefix("# "), lines


def same(before: Line, after: Line, *, exactly: bool) -> bool:
    """Whether a run is as it was.

    Args:
        before: Its line in the file.
        after: Its line now.
        exactly: To the last bit; else to ``DIGITS`` digits.
    """
    return before == after if exactly else before.coarse() == after.coarse()


def first_difference(before: Rows, after: Rows) -> str:
    """Where rows differ first, in words; empty where they do not."""
    if gone := [name for name in before if name not in after]:
        return f"no column {', '.join(gone)} any more"
    if new := [name for name in after if name not in before]:
        return f"new column {', '.join(new)}"
    counts = [len(next(iter(rows.values()), ())) for rows in (before, after)]
    for row in range(min(counts)):
        for name in before:
            if before[name][row] != after[name][row]:
                return f"row {row}, {name}: {before[name][row]!r} before, {after[name][row]!r} now"
    return "" if counts[0] == counts[1] else f"{counts[0]} rows before, {counts[1]} now"


def keep(folder: Path, name: str, found: Ran) -> None:
    """Keep a run's rows and report in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with gzip.open(folder / f"{name}.json.gz", "wt", compresslevel=3) as file:
        json.dump(
            {
                "rows": found.rows,
                "stop": found.stop,
                "status": found.status,
                "report": found.report,
            },
            file,
        )


def kept(folder: Path, name: str) -> Ran | None:
    """A run as it was kept; None where it was not."""
    try:
        with gzip.open(folder / f"{name}.json.gz", "rt") as file:
            return Ran(**json.load(file))
    except OSError:
        return None


def change(before: Line | None, after: Line, was: Ran | None, now: Ran) -> str:
    """How a run differs from what it was, in words.

    Args:
        before: Its line; None: there was no such run.
        after: Its line now.
        was: The run as it was kept, where it was.
        now: The run.
    """
    if before is None:
        return "new"
    parts = [
        f"{what} {getattr(before, what)} before, {getattr(after, what)} now"
        for what in ("stop", "status", "rows")
        if getattr(before, what) != getattr(after, what)
    ]
    if before.exact != after.exact:
        if was is None or line_of(after.name, was).exact != before.exact:
            where = "other rows (those of before are not kept here; see --against)"
        else:
            where = first_difference(was.rows, now.rows)
        parts.append(
            where + ("" if before.rounded != after.rounded else f", in digits beyond {DIGITS}")
        )
    if before.report != after.report:
        old, new = (json.loads(ran.report) if ran else {} for ran in (was, now))
        names = [name for name in new if name in old and old[name] != new[name]]
        told = [f"{name} {old[name]} before, {new[name]} now" for name in names]
        parts.append("the report: " + ("; ".join(told) or "other figures"))
    return "; ".join(parts)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/study same_rows",
        description=(__doc__ or "").splitlines()[0],
        epilog="Exit status: 0: all rows are equal; 1: some differ. Use --keep FOLDER in the older"
        " checkout, then --against FOLDER here.",
    )
    parser.add_argument("--write", action="store_true", help="replace tests/same_rows.txt")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="store the rows in FOLDER")
    parser.add_argument(
        "--against",
        type=Path,
        metavar="FOLDER",
        help="compare with the rows stored in FOLDER, instead of the digests",
    )
    parser.add_argument(
        "--only", nargs="+", choices=CASES, metavar="NAME", default=[*CASES], help="names of runs"
    )
    return parser.parse_args()


def main() -> None:
    """Run the cases and tell what differs."""
    options = _options()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    made_on, lines = lines_in(DIGESTS.read_text("utf-8")) if DIGESTS.exists() else ("", {})
    exactly = made_on == machine()
    changed = equal = 0
    old = KEPT
    if options.against is not None:
        old, lines, exactly = options.against, {}, True
    after = {}
    for case in options.only:
        now, was = ran(CASES[case]), kept(old, case)
        after[case] = line_of(case, now)
        before = line_of(case, was) if options.against and was else lines.get(case)
        equal += before == after[case]
        if before is None or not same(before, after[case], exactly=exactly):
            changed += 1
            print(f"{case}: {change(before, after[case], was, now)}", flush=True)
        if options.keep is not None or options.write:
            keep(options.keep or KEPT, case, now)
    how = "to the last bit" if exactly else f"to {DIGITS} digits, {equal} of them to the last bit"
    print(f"{len(after) - changed} of {len(after)} runs are the same, {how}")
    if options.write:
        _, old_lines = lines_in(DIGESTS.read_text("utf-8")) if DIGESTS.exists() else ("", {})
        all_lines = {**old_lines, **after}
        text = [f"# {machine()}", *(str(all_lines[name]) for name in CASES if name in all_lines)]
        DIGESTS.write_text("\n".join(text) + "\n", "utf-8")
    elif changed and options.keep is None:
        sys.exit(1)


if __name__ == "__main__":
    main()
