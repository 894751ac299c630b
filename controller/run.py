"""One run, from its plan to its end: under a supervisor, or inline on the simulated clock."""

from __future__ import annotations

import signal
from contextlib import closing
from types import FrameType

from controller.log.file import append_end
from controller.signals import on_signals
from controller.telemetry import Telemetry, Word
from controller.tree.inline import run_inline
from controller.tree.plan import Ended, Plan, Tell
from controller.tree.supervisor import Supervisor
from controller.tree.teller import Teller


def run(plan: Plan, tell: Tell) -> Ended:
    """Run a plan to its end; Ctrl-C, SIGTERM and SIGHUP stop it, however often they come.

    In real time Ctrl-Z does the same; a SIGHUP that nohup has had ignored stays ignored.
    SIGUSR1 asks to go back to the full wall after an oscillation has made it softer.

    Args:
        plan: What to run.
        tell: Called with what a person should know meanwhile.

    Raises:
        ServoError: The servo could not be started.
    """
    with closing(Telemetry.create()) as telemetry:
        return _run(plan, tell, telemetry)


def _run(plan: Plan, tell: Tell, telemetry: Telemetry) -> Ended:
    asked = False

    def stop(_signal: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        telemetry.words[Word.STOP] = 1

    def raise_again(_signal: int, _frame: FrameType | None) -> None:
        telemetry.words[Word.RAISE] += 1

    with on_signals(stop), on_signals(raise_again, (signal.SIGUSR1,)):
        if plan.config.loop.clock == "simulated":
            ended = run_inline(plan, telemetry, tell)
        else:
            with (
                on_signals(stop, (signal.SIGTSTP,)),  # stopped, nobody would watch the torque
                on_signals(signal.SIG_IGN, (signal.SIGTTOU,)),  # nor stopped for telling something
                Teller(tell) as teller,
            ):
                ended = Supervisor(plan, telemetry, teller).run()
        _tell_the_log(plan, ended, int(telemetry.words[Word.HEAD]))
    ended.asked = asked
    return ended


def _tell_the_log(plan: Plan, ended: Ended, rows: int) -> None:
    """Write how the run ended into its log, where a recorder has begun one."""
    facts = {
        "stop_reason": ended.stop_reason,
        "message": ended.cause or (ended.result or {}).get("message", ""),
        "ticks": ended.ticks,
        "missed": ended.missed,
        "rows": rows,
    }
    try:
        append_end(plan.log, facts, sync=plan.config.loop.clock != "simulated")
    except OSError as error:
        ended.warnings.append(f"the log does not tell how the run ended: {error.strerror or error}")
