"""Hands one damaged, crafted or edited file to the commands that read it, and notes the result.

The commands run in this process, so that thousands can be tried. Limits of time and memory are set
by the process that calls this.
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
from pathlib import Path
from random import Random
from typing import Any, NoReturn, cast
from unittest.mock import patch

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.live.client import Client, Messages
from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.system.printable import printable
from scripts import mutated_folders, mutated_texts, mutation_judges
from scripts.crafted_logs import crafted
from scripts.mutated_logs import Log, mutated

COMMISSION = ("commission", "simulated", "--set", "loop.clock=simulated", "--out")
LONGEST_S = 5.0
"""Of processor time, or waiting, for one command"""
_LONGEST_WAIT_S = 300.0
"""Of elapsed time: on a busy machine a command of seconds may wait for minutes"""


class TooLongError(BaseException):
    """A command took longer than it may."""


@dataclass(slots=True)
class Answer:
    """Result of a command."""

    status: int | None
    out: str
    err: str
    defect: str = ""
    """Where it was not foreseen, the traceback"""
    too_long: bool = False
    no_memory: bool = False


@dataclass(slots=True)
class Tried:
    """Result of one file."""

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
        number: Number of the file; with the seed it says all that is drawn.
        seed: Seed of the whole series.
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
        setattr(answer, name, stream.buffer.getvalue().decode("utf-8", "replace"))
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


def _note(trial: Tried, wrong: str) -> None:
    """Note what was wrong without a word, if anything was."""
    if wrong:
        trial.faults["wrong"] = wrong


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
        with patch.object(LiveServer, "run", one_turn):
            called(["live", path], trial, limited)
        if random.random() < 0.05:
            option = random.choice(("--plot", "--cut", "--mcap"))
            out = folder / "out.png"
            called(["log", path, "--from", "0.05", option, out], trial, limited)
            called(["detect", path, "--plot", out], trial, limited)
        if summary.status == 0 and csv.exists():
            seen = json.loads(detected.out) if detected.status == 0 else None
            report = json.loads(summary.out)
            trial.outcome, wrong = mutation_judges.of_log(log, report, csv, seen)
            _note(trial, wrong)

    return attempt


class _Page(Client):
    """A page that reads everything at once."""

    def __init__(self) -> None:
        super().__init__(cast("Any", None), 0, turns=False)

    def serve(self, new: Messages, _beat: int | None = None) -> None:
        self._texts.clear()
        self.tail = new.since(self.tail)[1]


async def one_turn(server: LiveServer, *_: object) -> None:
    """Take the place of ``LiveServer.run``: one page, one message of each kind, and no socket."""
    view = server._view
    view.welcome(_Page(), controls=False)
    await server.pump(lambda: True)
    await view.draw_map()


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
        text = path.read_text("utf-8-sig")
        _note(trial, mutation_judges.of_configuration(text, json.loads(answer.out)))


def _try_csv(random: Random, folder: Path, _base: Path, trial: Tried, limited: bool) -> None:
    path = folder / "a.csv"
    trial.how, table = mutated_texts.csv(random, path)
    answer = called(["detect", path, "--json"], trial, limited)
    called(["detect", path], trial, limited)
    if random.random() < 0.05:
        called(["detect", path, "--plot", folder / "out.png"], trial, limited)
    if answer.status == 0:
        trial.outcome, wrong = mutation_judges.of_csv(path, table, json.loads(answer.out))
        _note(trial, wrong)


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
    from haptic_wall.controller.experiments.commission import steps

    def refuse(_bench: object) -> NoReturn:
        raise UnidentifiableError("nothing is moved here")

    before = dict(steps.RUN)
    steps.RUN.update(dict.fromkeys(before, refuse))
    try:
        yield
    finally:
        steps.RUN.update(before)


KINDS: dict[str, Callable[..., None]] = {
    "logs": _try_log(mutated),
    "crafted": _try_log(crafted),
    "configurations": _try_configuration,
    "csvs": _try_csv,
    "folders": _try_folder,
}
"""Trials by their names"""

if __name__ == "__main__":
    sys.exit("run scripts/study mutations")
