"""Executes a planned run: under a supervisor in real time, or inline on the simulated clock."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, closing
from types import FrameType

from haptic_wall.controller.errors import LogFormatError, PlatformError
from haptic_wall.controller.logs.writer import append_end, identity
from haptic_wall.controller.processes.inline import run_inline
from haptic_wall.controller.processes.plan import Ended, LogState, Plan, Tell
from haptic_wall.controller.processes.recorder import rows_lacking
from haptic_wall.controller.processes.run_report import run_report
from haptic_wall.controller.processes.supervisor import Supervisor
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.system.signals import on_signals


@contextlib.contextmanager
def told_later(tell: Tell) -> Iterator[Tell]:
    """Yield what takes messages without waiting, and passes them on in order, all before the end.

    Args:
        tell: Passes a message on, and may block; an error (no reader) is ignored.
    """
    # The thread starts with the first message: by then the caller has left the loop's core, and the
    # thread inherits that.
    with ThreadPoolExecutor(1) as thread:

        def told(text: str) -> None:
            with contextlib.suppress(RuntimeError):  # no thread to be had
                thread.submit(tell, text)

        yield told


Shown = Callable[[Telemetry], AbstractContextManager[object]]
"""Displays a run while it goes on"""


def run(plan: Plan, tell: Tell, shown: Shown | None = None) -> Ended:
    """Execute a plan until it ends, or until Ctrl-C, SIGTERM or SIGHUP stops it.

    Repeated signals do no harm. In real time Ctrl-Z also stops the run; an ignored SIGHUP (nohup)
    stays ignored. SIGUSR1 requests the full gains again after a derating.

    Args:
        plan: The run.
        tell: Called with messages for a person.
        shown: Displays the run; None: no display.

    Raises:
        ServoError: The servo could not be started.
        PlatformError: This machine has no memory for its rows.
    """
    try:
        telemetry = Telemetry.create(len(plan.axes))
    except OSError as error:
        raise PlatformError(
            f"there is no memory for the rows ({error.strerror})",
            advice="raise the limits of this shell, ulimit -f and ulimit -v",
        ) from error
    asked = False

    def stop(_signal: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        telemetry.words[Word.STOP] = 1

    def raise_again(_signal: int, _frame: FrameType | None) -> None:
        telemetry.words[Word.RAISE] += 1

    # The display changes the terminal, which must be restored after any signal.
    with (
        closing(telemetry),
        on_signals(stop),
        on_signals(raise_again, (signal.SIGUSR1,)),
        ExitStack() as stack,
    ):
        if shown is not None:
            stack.enter_context(shown(telemetry))
        if plan.config.loop.clock == "simulated":
            ended = run_inline(plan, telemetry, tell)
        else:
            with (
                on_signals(stop, (signal.SIGTSTP,)),  # stopped, it could not watch
                on_signals(signal.SIG_IGN, (signal.SIGTTOU,)),  # nor may output stop it
                told_later(tell) as told,
            ):
                ended = Supervisor(plan, telemetry, told).run()
        ended.log = _finished_log(plan, ended, telemetry.words)
    ended.asked = asked
    return ended


def _finished_log(plan: Plan, ended: Ended, words: memoryview[int]) -> LogState:
    """Add the report of the run to its log, if the file is still there; return the log's state."""
    rows, written = words[Word.HEAD], words[Word.LOG_FILE]
    if not rows:
        return LogState.NONE
    found = identity(plan.log)
    if not written or found != written:
        if rows_lacking(words) < rows:
            there = "another file is in its place" if found else "it was removed or moved"
            ended.warnings.append(
                f"the log {plan.log} is missing: {there}; the run was not disturbed"
            )
        return LogState.MISSING
    result = ended.result or {}
    report = run_report(plan.config, ended, None, None)
    for place in ("log", "log_state", "plot", "changes"):
        del report[place]
    report |= {
        "message": ended.cause or result.get("message", ""),
        "rows": rows,
        "servo": result.get("facts"),
        "schedule": (result.get("bus") or {}).get("schedule"),
    }
    for name, part in report.get("axes", {}).items():
        part["servo"] = result.get("axes", {}).get(name, {}).get("servo")
    try:
        append_end(plan.log, report, ended.unlogged)
    except (OSError, LogFormatError) as error:
        why = getattr(error, "strerror", None) or error
        ended.warnings.append(f"the report is not in the log: {why}")
        return LogState.INCOMPLETE
    return LogState.WHOLE if ended.lacking == 0 else LogState.INCOMPLETE
