"""Passes changes of the running wall from the page to the run, as ``haptic-wall set`` does."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeGuard, get_args

from haptic_wall.controller.laws.table import LAWS
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.live.run_socket import MOST_BYTES, connected

WAIT_S: Final = 10.0
"""Longest wait for a moment that suits [s], as that of ``haptic-wall set``"""
OFFERED: Final = {name: kind for name, kind in LAWS.items() if name != "profile"}
"""Laws that a page may choose: it has no knob for a profile"""
NUMBERS: Final = {"wall.stiffness", "wall.damping", "wall.position", "delay.steps"} | {
    f"wall.{name}" for kind in OFFERED.values() for name in kind.numbers if name != "side"
}
"""Numbers that a page may change"""
_WORDS: Final = {"wall.law": tuple(OFFERED), "wall.side": get_args(Side)}
"""Words that a page may choose from"""


def is_number(value: object, most: float = 1e300) -> TypeGuard[int | float]:
    """Whether a value of a message is a number below ``most``: an integer may have any length."""
    return type(value) in (int, float) and abs(value) < most  # type: ignore[arg-type]


def sets_of(changes: object, axis: str = "") -> list[str] | None:
    """Return changes as ``PATH=VALUE``; None: they are not what a page may change.

    It may change numbers, and choose one of the laws that come with the program, and the wall's
    side. It names no file and no class.

    Args:
        changes: A mapping from path to value, as a page sent it.
        axis: Name of the axis whose wall is meant; empty: there is one without a name.
    """
    if not isinstance(changes, dict) or not changes:
        return None
    for path, value in changes.items():
        if path in _WORDS:
            if value not in _WORDS[path]:
                return None
        elif path not in NUMBERS or not is_number(value):
            return None
    whose = f"axes.{axis}." if axis else ""
    return [f"{whose}{path}={json.dumps(value)}" for path, value in changes.items()]


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
