"""Displays a run in one line of the terminal, and reads the keys that end it."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from haptic_wall.controller.cli.working import CLEAR, columns_of, in_foreground
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.laws.wall import SIGNS
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_SATURATED,
    FLAG_WARM_UP,
    Telemetry,
    Word,
)
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.clock import ready
from haptic_wall.hw.servo import Outcome

EVERY_S: Final = 0.1
BAR: Final = 11
"""Characters of the bar, one of them its middle"""
ENDING_KEYS: Final = b" q"
_RED, _YELLOW, _PLAIN = "\x1b[31m", "\x1b[33m", "\x1b[0m"


@dataclass(frozen=True, slots=True)
class Shown:
    """The values in the line."""

    state: str
    wrong: int
    """0: fine; 1: limited; 2: faulty"""
    position: float
    """[rad]"""
    depth: float
    """Penetration [rad]; for a two-sided wall the distance from its surface"""
    torque: float
    """[N·m]"""
    largest: float
    """Largest torque so far [N·m]"""
    stiffness: float
    """[N·m/rad]"""
    lost: int
    age_ms: float


def line_of(shown: Shown, columns: int, *, colour: bool) -> str:
    """Format the line; cut its end if it is wider than ``columns`` - 1."""
    parts = [
        f"{shown.state:9} {bar_of(shown.torque, shown.largest)}",
        f" {shown.torque:+7.3f} N·m",
        f"  x {shown.position:+8.4f} rad",
        f"  depth {shown.depth:+8.4f}",
        f"  K {shown.stiffness:.4g}",
        f"  lost {shown.lost}",
        f"  age {shown.age_ms:.2f} ms",
    ]
    while len(parts) > 1 and sum(map(len, parts)) >= columns:
        parts.pop()
    text = "".join(parts)[: max(0, columns - 1)]
    if not (colour and shown.wrong):
        return text
    return (_RED if shown.wrong > 1 else _YELLOW) + text + _PLAIN


def bar_of(torque: float, largest: float) -> str:
    """Return a bar that grows with the torque, from the middle to the left or right."""
    half = BAR // 2
    share = abs(torque) / largest if largest > 0.0 and math.isfinite(torque) else 0.0
    filled = "#" * min(half, round(share * half))
    left = filled.rjust(half) if torque < 0.0 else " " * half
    right = filled.ljust(half) if torque > 0.0 else " " * half
    return f"[{left}|{right}]"


class RunView:
    """Reads the values of the newest row from a run's shared memory."""

    def __init__(self, config: Config, telemetry: Telemetry) -> None:
        self._config = config
        self._telemetry = telemetry
        self._tail = 0
        self._lost = 0
        self._largest = 0.0
        self._surface = math.nan

    def look(self) -> Shown | None:
        """Return the values to show; None if there is no row yet."""
        rows, self._tail = self._telemetry.read(self._tail)
        if not len(rows):
            return None
        fine = (rows["outcome"] == Outcome.OK) | (rows["outcome"] == Outcome.WAITING)
        self._lost += int(np.count_nonzero(~fine))
        torque: FloatArray = rows["torque"]
        position: FloatArray = rows["position"]
        self._largest = max(self._largest, float(np.abs(torque).max()))
        known = position[np.isfinite(position)]
        if math.isnan(self._surface) and known.size:
            self._surface = self._config.surface(float(known[0]))
        row = rows[-1]
        depth = float(row["position"]) - self._surface
        sign = SIGNS[self._config.wall.acting_side]
        if sign:
            depth = max(0.0, sign * depth)
        state, wrong = _state(row, lost=not bool(fine.all()))
        return Shown(
            state,
            wrong,
            float(row["position"]),
            depth,
            float(row["torque"]),
            self._largest,
            float(row["stiffness"]),
            self._lost,
            float(row["age_ns"]) * 1e-6,
        )


def _state(row: Any, *, lost: bool) -> tuple[str, int]:  # noqa: ANN401 - a record
    flags, oscillation = int(row["flags"]), State(int(row["oscillation"]))
    if oscillation >= State.SUSTAINED:
        return oscillation.name.lower(), 2
    if lost:
        return "losses", 2
    if flags & FLAG_WARM_UP:
        return "warm-up", 0
    if flags & FLAG_OFF:
        return "wall off", 1
    if flags & FLAG_SATURATED:
        return "limited", 1
    return ("contact" if flags & FLAG_CONTACT else "free"), 0


@contextlib.contextmanager
def live_line(
    config: Config, telemetry: Telemetry, tell: Callable[[str], None]
) -> Iterator[Callable[[str], None]]:
    """Show the run's line until the block ends; space or ``q`` ends the run with torque off.

    The terminal is left as it was found, however the block ends.

    Yields:
        A variant of ``tell`` that does not overwrite the line.
    """
    done = threading.Event()
    writing = threading.Lock()

    def told(text: str) -> None:
        with writing:
            _write(CLEAR)
            tell(text)

    with _keys() as keyboard:
        thread = threading.Thread(
            target=_show, args=(RunView(config, telemetry), telemetry, keyboard, done, writing)
        )
        thread.daemon = True
        thread.start()
        try:
            yield told
        finally:
            done.set()
            thread.join(10.0 * EVERY_S)
            _write(CLEAR)


def _show(
    view: RunView,
    telemetry: Telemetry,
    keyboard: int | None,
    done: threading.Event,
    writing: threading.Lock,
) -> None:
    colour = not os.environ.get("NO_COLOR")
    while not done.is_set():
        if _pressed(keyboard, done):
            telemetry.words[Word.STOP] = 1
        shown = view.look()
        if shown is not None and not done.is_set() and in_foreground(sys.stdout.fileno()):
            columns = columns_of(sys.stdout.fileno())
            with writing:
                _write(CLEAR + line_of(shown, columns, colour=colour))


def _pressed(keyboard: int | None, done: threading.Event) -> bool:
    """Wait for the next update; return whether a key asked for the end."""
    if keyboard is None:
        done.wait(EVERY_S)
        return False
    try:
        if not ready([keyboard], EVERY_S):
            return False
        keys = os.read(keyboard, 64)
    except OSError:
        keys = b""
    if not keys:  # the terminal has gone
        done.wait(EVERY_S)
    return any(key in ENDING_KEYS for key in keys)


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
