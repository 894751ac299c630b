"""Displays a run in one line of the terminal, and reads the keys that end it."""

from __future__ import annotations

import contextlib
import os
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from haptic_wall.controller.cli.working import CLEAR, columns_of
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
_RED, _YELLOW, _PLAIN = "\x1b[31m", "\x1b[33m", "\x1b[0m"


def line_of(row: Any, lost: int, *, loses: bool, columns: int, colour: bool) -> str:  # noqa: ANN401 - a record
    """Format the line of a row; cut its end if it is wider than ``columns`` - 1.

    Args:
        row: The newest row, of ``telemetry.ROW``.
        lost: Number of failed readings so far.
        loses: Whether one of the last readings has failed.
        columns: Width of the terminal.
        colour: Whether a limit or a fault is coloured.
    """
    state, mark = _state(row, loses=loses)
    parts = [
        f"{state:9} {row['torque']:+7.3f} N·m",
        f"  x {row['position']:+8.4f} rad",
        f"  K {row['stiffness']:.4g}",
        f"  lost {lost}",
        f"  age {row['age_ns'] * 1e-6:.2f} ms",
    ]
    while len(parts) > 1 and sum(map(len, parts)) >= columns:
        parts.pop()
    text = "".join(parts)[: max(0, columns - 1)]
    return mark + text + _PLAIN if colour and mark else text


def _state(row: Any, *, loses: bool) -> tuple[str, str]:  # noqa: ANN401 - a record
    """Return the state and its colour."""
    flags, oscillation = int(row["flags"]), State(int(row["oscillation"]))
    if oscillation >= State.SUSTAINED:
        return oscillation.name.lower(), _RED
    if loses:
        return "losses", _RED
    if flags & FLAG_WARM_UP:
        return "warm-up", ""
    if flags & FLAG_OFF:
        return "wall off", _YELLOW
    if flags & FLAG_SATURATED:
        return "limited", _YELLOW
    return ("contact" if flags & FLAG_CONTACT else "free"), ""


@contextlib.contextmanager
def live_line(telemetry: Telemetry, tell: Callable[[str], None]) -> Iterator[Callable[[str], None]]:
    """Show the run's line until the block ends; space or ``q`` ends the run with torque off.

    The terminal is left as it was found, however the block ends.

    Yields:
        A variant of ``tell`` that does not overwrite the line.
    """
    done, writing = threading.Event(), threading.Lock()

    def told(text: str) -> None:
        with writing:
            _write(CLEAR)
            tell(text)

    def show() -> None:
        colour, tail, lost = not os.environ.get("NO_COLOR"), 0, 0
        while not done.is_set():
            if _pressed(keyboard, done):
                telemetry.words[Word.STOP] = 1
            rows, tail = telemetry.read(tail)
            fine = np.isin(rows["outcome"], (Outcome.OK, Outcome.WAITING))
            failed = len(rows) - int(np.count_nonzero(fine))
            lost += failed
            width = columns_of(sys.stdout.fileno())
            if len(rows) and width and not done.is_set():
                with writing:
                    text = line_of(rows[-1], lost, loses=failed > 0, columns=width, colour=colour)
                    _write(CLEAR + text)

    with _keys() as keyboard:
        thread = threading.Thread(target=show, daemon=True)
        thread.start()
        try:
            yield told
        finally:
            done.set()
            thread.join(10.0 * EVERY_S)
            _write(CLEAR)


def _pressed(keyboard: int | None, done: threading.Event) -> bool:
    """Wait for the next update; return whether a key asked for the end."""
    if keyboard is None:
        done.wait(EVERY_S)
        return False
    try:
        keys = os.read(keyboard, 64) if ready([keyboard], EVERY_S) else None
    except OSError:
        keys = b""
    if keys == b"":  # the terminal has gone
        done.wait(EVERY_S)
    return any(key in ENDING_KEYS for key in keys or b"")


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


def _write(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.write(text)
        sys.stdout.flush()
