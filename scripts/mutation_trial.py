"""One file that was damaged, crafted or edited, handed to the commands that read it; what became.

The commands run in this process, so that thousands can be tried. Limits of time and memory are for
whoever makes a process for it.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import os
import shutil
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import yaml

from controller.cli.main import main
from controller.experiments.identification import UnidentifiableError
from controller.log.columns import COLUMNS
from controller.printable import printable
from controller.telemetry import FLAG_WARM_UP
from scripts import mutated_folders, mutated_texts
from scripts.crafted_logs import crafted
from scripts.mutated_logs import Key, Log, mutated
from scripts.mutated_texts import NUMBER, Table

COMMISSION = ("commission", "simulated", "--set", "loop.clock=simulated", "--out")
LONGEST_S = 5.0
"""Of processor time, or waiting, for one command"""
_LONGEST_WAIT_S = 60.0
_STEP_S = 1e-3
"""Between rows of a log that was made here"""


class TooLongError(BaseException):
    """A command took longer than it may."""


@dataclass(slots=True)
class Answer:
    """What a command did."""

    status: int | None
    out: str
    err: str
    defect: str = ""
    """Where it was not foreseen, the traceback"""
    too_long: bool = False
    no_memory: bool = False


@dataclass(slots=True)
class Tried:
    """What became of one file."""

    kind: str
    number: int
    how: str
    outcome: str = "refused"
    """``read``, ``told`` (read, and told that something is wrong with it) or ``refused``"""
    faults: dict[str, str] = field(default_factory=dict)
    """By kind: traceback, hang, memory, terminal, wrong"""


def tried(kind: str, number: int, seed: int, folder: Path, base: Path, *, limited: bool) -> Tried:
    """Make a file and try the commands that read it.

    Args:
        kind: A key of ``KINDS``.
        number: Of the file; with the seed it says all that is drawn.
        seed: Of the whole series.
        folder: Where files are made; empty, and empty afterwards.
        base: A commissioning that is finished.
        limited: Whether a command is ended after ``LONGEST_S``.
    """
    trial = Tried(kind, number, "")
    try:
        KINDS[kind](Random(f"{seed} {kind} {number}"), folder, base, trial, limited)
    finally:
        for left in folder.iterdir():
            shutil.rmtree(left) if left.is_dir() and not left.is_symlink() else left.unlink()
    return trial


def called(words: Sequence[str | Path], trial: Tried, limited: bool) -> Answer:
    """Run a command, and note what no command may do."""
    answer = _answer([str(word) for word in words], limited)
    text = answer.out + answer.err
    named = " ".join(map(str, words[:1]))
    if answer.too_long:
        trial.faults["hang"] = f"{named}: {answer.defect}"
    elif answer.no_memory:
        trial.faults["memory"] = f"{named}: {answer.defect}"
    elif answer.defect or answer.status not in (0, 2, 4):
        trial.faults["traceback"] = f"{named} ({answer.status}): {answer.defect or text[-300:]}"
    elif answer.status and not answer.err.strip():
        trial.faults["traceback"] = f"{named}: refused without a word"
    if text != printable(text):
        trial.faults["terminal"] = f"{named}: {text[:300]!a}"
    return answer


def _answer(words: list[str], limited: bool) -> Answer:
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8") for _ in range(2))
    answer = Answer(None, "", "")
    with warnings.catch_warnings(), _in_time(limited):
        warnings.simplefilter("error")
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                answer.status = main(words)
        except SystemExit as ended:
            answer.status = ended.code if isinstance(ended.code, int) else 1
        except TooLongError:
            answer.too_long, answer.defect = True, _last_lines()
        except MemoryError:
            answer.no_memory, answer.defect = True, _last_lines()
        except Exception:  # noqa: BLE001 - which is what is looked for
            answer.defect = _last_lines()
    for stream, name in ((out, "out"), (err, "err")):
        stream.flush()
        setattr(answer, name, stream.buffer.getvalue().decode("utf-8", "replace"))  # type: ignore[attr-defined]
    if "Traceback (most recent call last)" in answer.err:
        answer.defect = answer.err[-1000:]
    return answer


def _last_lines() -> str:
    return "".join(traceback.format_exc()[-1000:])


@contextlib.contextmanager
def _in_time(limited: bool) -> Iterator[None]:
    """End whatever takes longer than it may, where that is wanted."""

    def end(_signal: int, _frame: object) -> None:
        raise TooLongError

    if not limited:
        yield
        return
    signal.signal(signal.SIGPROF, end)
    signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    signal.setitimer(signal.ITIMER_REAL, _LONGEST_WAIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)


# Logs


def _try_log(make: Callable[[Random], tuple[str, Log]]) -> Callable[..., None]:
    def attempt(random: Random, folder: Path, _base: Path, trial: Tried, limited: bool) -> None:
        trial.how, log = make(random)
        path, csv = folder / random.choice(("a.hwlog", "a.csv")), folder / "out.csv"
        path.write_bytes(log.content)
        if log.sparse:
            os.truncate(path, log.sparse)
        summary = called(["log", path, "--json", "--csv", csv], trial, limited)
        detected = called(["detect", path, "--json"], trial, limited)
        called(["log", path], trial, limited)
        if random.random() < 0.05:
            option = random.choice(("--plot", "--cut", "--mcap"))
            out = folder / "out.png"
            called(["log", path, "--from", "0.05", option, out], trial, limited)
            called(["detect", path, "--plot", out], trial, limited)
        if summary.status == 0 and csv.exists():
            _judge_log(log, json.loads(summary.out), csv, detected, trial)

    return attempt


def _judge_log(
    log: Log, summary: dict[str, Any], csv: Path, detected: Answer, trial: Tried
) -> None:
    """Whether all rows that were read were written, and what is missing was told."""
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
    trial.outcome = "told" if said else "read"
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
    if detected.status == 0:
        wrong += _disagreement(cells, json.loads(detected.out))
    if wrong:
        trial.faults["wrong"] = "; ".join(wrong)


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


# Texts


def _try_configuration(
    random: Random, folder: Path, _base: Path, trial: Tried, limited: bool
) -> None:
    path = folder / "a.yaml"
    trial.how = mutated_texts.configuration(random, path)
    answer = called(["config", path, "--json"], trial, limited)
    called(["config", path], trial, limited)
    if answer.status == 0:
        trial.outcome = "read"
        _judge_configuration(path.read_text("utf-8-sig"), json.loads(answer.out), trial)


def _judge_configuration(text: str, report: dict[str, Any], trial: Tried) -> None:
    """Whether the numbers that are in force are those in the file, by another reader."""
    held = yaml.load(text, yaml.BaseLoader)
    if not isinstance(held, dict) or "<<" in text:
        return
    for section, keys in held.items():
        for key, value in keys.items() if isinstance(keys, dict) else ():
            found = report["fields"].get(f"{section}.{key}")
            if found is None or not isinstance(value, str) or not NUMBER.fullmatch(value):
                continue
            if found["value"] != float(value):
                trial.faults["wrong"] = f"{section}.{key}: {value} became {found['value']}"


def _try_csv(random: Random, folder: Path, _base: Path, trial: Tried, limited: bool) -> None:
    path = folder / "a.csv"
    trial.how, table = mutated_texts.csv(random, path)
    answer = called(["detect", path, "--json"], trial, limited)
    called(["detect", path], trial, limited)
    if random.random() < 0.05:
        called(["detect", path, "--plot", folder / "out.png"], trial, limited)
    if answer.status == 0:
        _judge_csv(path, table, json.loads(answer.out), trial)


def _judge_csv(path: Path, table: Table | None, report: dict[str, Any], trial: Tried) -> None:
    """Whether all rows were looked at, or what was not was told."""
    notes = [note for note in report["notes"] if "no column" not in note]
    trial.outcome = "told" if notes else "read"
    if table is None:
        with path.open(encoding="utf-8-sig", errors="replace") as file:  # any line end
            rows = sum(bool(line.strip()) for line in file) - 1
        if not notes and report["samples"] != rows:
            trial.faults["wrong"] = f"{report['samples']} samples of {rows} rows without a word"
    elif abs(report["samples"] - table.rows) > 0.02 * table.rows:
        trial.faults["wrong"] = f"{report['samples']} samples of {table.rows} rows"
    elif not abs(report["period_s"] / table.periods[0] - 1.0) < 0.1:
        trial.faults["wrong"] = f"a period of {report['period_s']} s, not {table.periods[0]}"


# Folders


def _try_folder(random: Random, folder: Path, base: Path, trial: Tried, limited: bool) -> None:
    made = folder / "made"
    trial.how = mutated_folders.edited(random, base, made)
    with _still():
        answer = called([*COMMISSION, made, "--json"], trial, limited)
    trial.outcome = "read" if answer.status == 0 else "refused"
    page = made / "report.html"
    if answer.status != 2 and page.is_file() and not page.is_symlink():
        shown = page.read_bytes()
        secret = mutated_folders.SECRET
        if secret in shown or base64.b64encode(secret)[:20] in shown:
            trial.faults["wrong"] = "a file from outside is in the report"
        if b"<script>alert" in shown:
            trial.faults["wrong"] = "the report runs a script out of the folder"


@contextlib.contextmanager
def _still() -> Iterator[None]:
    """While steps of a commissioning move nothing, and fail."""
    from controller.commission import steps

    def refuse(_bench: object) -> None:
        raise UnidentifiableError("nothing is moved here")

    names = ("run_doctor", "run_identify", "run_delay", "run_rendered", "run_sweep")
    before = {name: getattr(steps, name) for name in names}
    for name in names:
        setattr(steps, name, refuse)
    try:
        yield
    finally:
        for name in names:
            setattr(steps, name, before[name])


KINDS: dict[str, Callable[..., None]] = {
    "logs": _try_log(mutated),
    "crafted": _try_log(crafted),
    "configurations": _try_configuration,
    "csvs": _try_csv,
    "folders": _try_folder,
}
"""What is tried, by its name"""

if __name__ == "__main__":
    sys.exit("run scripts/mutations")
