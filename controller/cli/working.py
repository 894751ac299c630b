"""Displays a terminal line with the present activity, its duration and the remaining time.

It is written on standard error, and only where that is a terminal whose foreground is this
program's. ``options.say`` and ``options.answer`` remove it before they write.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from haptic_wall.controller.cli.interrupt import CLEAR

FIRST_S: Final = 0.5
"""Shorter activities are not shown [s]"""
EVERY_S: Final = 0.5
DRAWING_S: Final = 2.0
"""Approximate duration of a picture, mostly for imports [s]"""
_writing = threading.RLock()
_at_work: list[Work] = []


@dataclass(slots=True)
class Work:
    """The present activity."""

    label: str
    about_s: float | None
    """Expected duration [s]; None: unknown"""
    share: Callable[[], float | None] | None
    """Returns its finished fraction, 0 to 1"""
    own: Callable[[int], str] | None = None
    """Returns the line, within a width, in place of label and times; empty: as before"""
    began: float = field(default_factory=time.monotonic)
    drawn: bool = False

    def text(self) -> str:
        """Return the line."""
        passed = time.monotonic() - self.began
        share = None if self.share is None else self.share()
        about = passed / share if share else self.about_s
        if about is None:
            return f"{self.label}: {length(passed)}"
        left = f"about {length(about - passed)} left"
        rest = left if about > passed else f"{length(about)} were expected"
        return f"{self.label}: {length(passed)}, {rest}"


def length(seconds: float) -> str:
    """Format a time in whole seconds or minutes."""
    return f"{max(1.0, seconds):.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


@contextlib.contextmanager
def working(
    label: str,
    about_s: float | None = None,
    share: Callable[[], float | None] | None = None,
    *,
    text: Callable[[int], str] | None = None,
    every_s: float = EVERY_S,
) -> Iterator[Work]:
    """Show an activity until the block ends; inside another one, in its place.

    Args:
        label: The activity.
        about_s: Expected duration [s]; None: unknown.
        share: Returns its finished fraction, 0 to 1, used to estimate the rest; called in a thread
            of its own.
        text: Returns the line for a terminal of that many columns, in place of all these.
        every_s: Time between two of them [s].
    """
    work = Work(label, about_s, share, text)
    if not is_shown(sys.stderr):
        yield work
        return
    done = threading.Event()
    thread = threading.Thread(target=_show, args=(work, done, every_s), daemon=True)
    with aside():
        _at_work.append(work)
    thread.start()
    try:
        yield work
    finally:
        done.set()
        thread.join(2.0 * EVERY_S)
        with aside():
            _at_work.remove(work)


def is_shown(stream: object) -> bool:
    """Whether a standard stream is a terminal on which a line can be overwritten."""
    try:
        return bool(stream.isatty()) and os.environ.get("TERM") != "dumb"  # type: ignore[attr-defined]
    except (AttributeError, ValueError):  # closed or replaced
        return False


def columns_of(number: int) -> int:
    """Return the width of a terminal; 0 where this process is not in its foreground."""
    try:
        return (os.get_terminal_size(number).columns or 80) * (os.tcgetpgrp(number) == os.getpgrp())
    except OSError:
        return 0


@contextlib.contextmanager
def aside() -> Iterator[None]:
    """Remove the line, if shown, for the duration of a block."""
    with _writing:
        for work in _at_work:
            if work.drawn:
                _write(CLEAR)
                work.drawn = False
        yield


def _show(work: Work, done: threading.Event, every_s: float) -> None:
    wait = min(FIRST_S, every_s)
    while not done.wait(wait):
        wait = every_s
        columns = columns_of(2)
        line = work.text()[: columns - 1] if work.own is None else work.own(columns)
        with _writing:
            if _at_work[-1:] == [work] and columns and line and not done.is_set():
                _write(CLEAR + line.encode(errors="replace"))
                work.drawn = True


def _write(text: bytes) -> None:
    with contextlib.suppress(OSError):
        os.write(2, text)
