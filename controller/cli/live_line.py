"""Displays a run in the line of ``working``, and reads the keys that end it."""

from __future__ import annotations

import contextlib
import os
import sys
import termios
import tty
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from haptic_wall.controller.cli.working import working
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_SATURATED,
    FLAG_WARM_UP,
    Telemetry,
    Word,
)
from haptic_wall.hw.clock import ready
from haptic_wall.hw.servo import Outcome

EVERY_S: Final = 0.1
ENDING_KEYS: Final = b" q"


def line_of(row: Any, lost: int, *, loses: bool, columns: int) -> str:  # noqa: ANN401 - a record
    """Format the line of a row; cut its end if it is wider than ``columns`` - 1.

    Args:
        row: The newest row, of ``telemetry.ROW``.
        lost: Number of failed readings so far.
        loses: Whether one of the last readings has failed.
        columns: Width of the terminal.
    """
    parts = [
        f"{_state(row, loses=loses):9} {row['torque']:+7.3f} N·m",
        f"  x {row['position']:+8.4f} rad",
        f"  K {row['stiffness']:.4g}",
        f"  lost {lost}",
        f"  age {row['age_ns'] * 1e-6:.2f} ms",
    ]
    while len(parts) > 1 and sum(map(len, parts)) >= columns:
        parts.pop()
    return "".join(parts)[: max(0, columns - 1)]


def worst_of(rows: Sequence[Any], failed: Sequence[int]) -> int:
    """Return the index of the axis that a person must look at first.

    Args:
        rows: The newest row of each axis.
        failed: Number of the last readings of each that have failed.
    """
    order = [
        (row["oscillation"], lost > 0, abs(row["torque"]))
        for row, lost in zip(rows, failed, strict=True)
    ]
    return order.index(max(order))


def _state(row: Any, *, loses: bool) -> str:  # noqa: ANN401 - a record
    flags, oscillation = int(row["flags"]), State(int(row["oscillation"]))
    if oscillation >= State.SUSTAINED:
        return oscillation.name.lower()
    states = {"losses": loses, "warm-up": flags & FLAG_WARM_UP, "wall off": flags & FLAG_OFF}
    states |= {"limited": flags & FLAG_SATURATED, "contact": flags & FLAG_CONTACT, "free": True}
    return next(state for state, holds in states.items() if holds)


@contextlib.contextmanager
def live_line(telemetry: Telemetry, axes: Sequence[str]) -> Iterator[None]:
    """Show the run's line until the block ends; space or ``q`` ends the run with torque off.

    The terminal is left as it was found, however the block ends.

    Args:
        telemetry: Of the run.
        axes: Names of the axes; the line shows the worst of several.
    """
    tail = lost = 0

    def text(columns: int) -> str:
        nonlocal tail, lost
        if keyboard is not None and ready([keyboard], 0.0):
            with contextlib.suppress(OSError):  # the terminal has gone
                if any(key in ENDING_KEYS for key in os.read(keyboard, 64)):
                    telemetry.words[Word.STOP] = 1
        rows, tail = telemetry.read(tail)
        if not len(rows):
            return ""
        failed = np.count_nonzero(rows["outcome"] != Outcome.OK, axis=0)
        lost += int(failed.sum())
        last = rows[-1]
        worst = worst_of(last, failed)
        of = f"{axes[worst]}: " if axes[worst] else ""
        loses = bool(failed[worst])
        return of + line_of(last[worst], lost, loses=loses, columns=columns - len(of))

    with _keys() as keyboard, working("", text=text, every_s=EVERY_S):
        yield


@contextlib.contextmanager
def _keys() -> Iterator[int | None]:
    """Yield a terminal in single-key mode; None if no terminal is in the foreground."""
    try:
        keyboard = sys.stdin.fileno()
        before = termios.tcgetattr(keyboard)
        ours = os.tcgetpgrp(keyboard) == os.getpgrp()
    except (OSError, ValueError, AttributeError, termios.error):
        ours = False
    if not ours:
        yield None
        return
    try:
        tty.setcbreak(keyboard, termios.TCSANOW)  # Ctrl-C and Ctrl-Z stay what they are
        yield keyboard
    finally:
        with contextlib.suppress(termios.error):
            termios.tcsetattr(keyboard, termios.TCSANOW, before)
