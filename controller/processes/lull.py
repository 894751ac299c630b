"""The quiet part of a period, from the end of a tick to the next deadline: when others may work.

Between a deadline and the torque that follows from it bytes are under way to the loop, through
kernel threads that want a core of those that the supervisor and the recorder have. Whoever runs in
a kernel call just then is not interrupted for them, and the torque is late by his work.
"""

from __future__ import annotations

import time

from haptic_wall.controller.runtime.telemetry import Word

_SETTLED_NS = 20_000
"""What the torque's bytes need to be gone, after the tick has ended [ns]"""
_SILENT = 10
"""Periods without a sign of life after which nobody waits for the loop's lulls"""


def until_lull(words: memoryview[int], period_ns: int, pause_s: float) -> float:
    """How long to pause [s] so that a lull of the loop begins; at most a period longer than wanted.

    Where the loop gives no sign of life, just as long.

    Args:
        words: The control words.
        period_ns: Of the loop [ns].
        pause_s: What is wanted [s].
    """
    now_ns = time.monotonic_ns()
    ended_ns = words[Word.HEARTBEAT_NS]
    pause_ns = round(pause_s * 1e9)
    if abs(now_ns - ended_ns) <= _SILENT * period_ns:
        pause_ns += (ended_ns + _SETTLED_NS - now_ns - pause_ns) % period_ns
    return pause_ns * 1e-9


def pause_until_lull(words: memoryview[int], period_ns: int, pause_s: float) -> None:
    """Sleep so long; see ``until_lull``."""
    time.sleep(until_lull(words, period_ns, pause_s))
