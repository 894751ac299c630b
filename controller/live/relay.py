"""Passes changes of the running wall from the page to the run, as ``haptic-wall set`` does."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeGuard

from haptic_wall.controller.laws.table import LAWS
from haptic_wall.controller.processes.run_socket import MOST_BYTES, connected

WAIT_S: Final = 10.0
"""Longest wait for a moment that suits [s], as that of ``haptic-wall set``"""
NUMBERS: Final = frozenset(
    {
        "wall.stiffness",
        "wall.damping",
        "wall.position",
        "wall.count",
        "wall.width",
        "wall.snap",
        "wall.low",
        "wall.high",
        "wall.friction",
        "wall.period",
        "delay.steps",
    }
)
"""Numbers that a page may change"""


def is_number(value: object, most: float = 1e300) -> TypeGuard[int | float]:
    """Whether a value of a message is a number below ``most``: an integer may have any length."""
    return type(value) in (int, float) and abs(value) < most  # type: ignore[arg-type]


def sets_of(changes: object) -> list[str] | None:
    """Return changes as ``PATH=VALUE``; None: they are not what a page may change.

    It may change numbers, and choose one of the laws that come with the program. It names no file
    and no class.

    Args:
        changes: A mapping from path to value, as a page sent it.
    """
    if not isinstance(changes, dict) or not changes:
        return None
    for path, value in changes.items():
        if path == "wall.law":
            if not isinstance(value, str) or value not in LAWS or value == "profile":
                return None
        elif path not in NUMBERS or not is_number(value):
            return None
    return [f"{path}={json.dumps(value)}" for path, value in changes.items()]


async def ask(run: Path, sets: list[str], tell: Callable[[dict[str, Any]], None]) -> None:
    """Ask for a change; cancelled, it is withdrawn if it still waits.

    Args:
        run: Socket of the run.
        sets: Changes as ``PATH=VALUE``.
        tell: Called with each answer of the run; the last has ``applied`` or ``error``.
    """
    try:
        connection = connected(run)
        connection.setblocking(False)
        reader, writer = await asyncio.open_unix_connection(sock=connection, limit=MOST_BYTES)
    except OSError:
        tell({"error": "the run accepts no changes: it is over, or has not started yet"})
        return
    try:
        writer.write((json.dumps({"set": sets, "wait_s": WAIT_S}) + "\n").encode())
        while line := await reader.readline():
            tell(json.loads(line))
    except (OSError, ValueError):
        tell({"error": "the run does not answer"})
    finally:
        writer.close()
