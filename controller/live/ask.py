"""Asks a running wall for a change, from another process."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any, Final

from haptic_wall.controller.errors import HapticWallError, UserError
from haptic_wall.controller.live.run_socket import AliveRun, connected
from haptic_wall.hw.errors import Problem

COMPUTING_S: Final = 120.0
"""Longest time for the answer besides the wait [s]: the guard computes, behind other requests"""


class NotAppliedError(HapticWallError):
    """A change was refused, or its moment did not come."""

    def __init__(self, problem: Problem, exit_status: int) -> None:
        super().__init__(problem)
        self.exit_status = exit_status


def ask(
    run: AliveRun, sets: Sequence[str], wait_s: float, tell: Callable[[str], None]
) -> dict[str, Any]:
    """Ask for a change, and wait for the answer.

    Args:
        run: The running wall.
        sets: Changes as ``PATH=VALUE``.
        wait_s: Longest wait for a moment that suits [s].
        tell: Called with why it waits.

    Returns:
        ``applied``, ``changed``, ``waited_s``, ``row`` and ``guard``, as in the report.

    Raises:
        NotAppliedError: It was refused, or the moment did not come; the wall is as before.
        UserError: The run has ended.
    """
    try:
        with connected(run.socket) as connection:
            connection.settimeout(wait_s + COMPUTING_S)
            connection.sendall((json.dumps({"set": list(sets), "wait_s": wait_s}) + "\n").encode())
            for line in connection.makefile("rb"):
                told: dict[str, Any] = json.loads(line)
                if "waits" in told:
                    tell(f"waits: {told['waits']}")
                elif "error" in told:
                    raise _not_applied(told)
                else:
                    return told
    except (OSError, ValueError) as error:  # it has ended, perhaps within a line
        if isinstance(error, HapticWallError):
            raise
    raise UserError(
        f"the run of {run.log} has ended, or does not answer",
        field="--run",
        advice="its report lists the applied changes",
    )


def _not_applied(told: dict[str, Any]) -> NotAppliedError:
    """Return the error of an answer: its sentence names field and advice already."""
    text = str(told["error"])
    error = NotAppliedError(Problem(text), int(told.get("exit_status", 2)))
    error.problem = Problem(text, field=told.get("field"), advice=told.get("advice") or "")
    return error
