"""Waits for the idle window of a period, from the end of a tick to the next deadline.

Between a deadline and its torque, bytes travel to the loop and back through kernel threads. These
threads need a core that the supervisor and the recorder also use. The kernel does not interrupt a
system call of another process for them, so such a call would delay the torque. The other processes
therefore work in the idle window.
"""

from __future__ import annotations

import time

from haptic_wall.controller.runtime.telemetry import Word

_SETTLED_NS = 20_000
"""Time after the end of a tick until the torque's bytes have left [ns]"""
_SILENT = 10
"""Periods without a heartbeat after which processes no longer wait for the idle window"""


def until_idle_window(words: memoryview[int], period_ns: int, pause_s: float) -> float:
    """Return the pause [s] after which an idle window begins: ``pause_s`` plus at most a period.

    Without a heartbeat of the loop it is ``pause_s``.

    Args:
        words: The control words.
        period_ns: Period of the loop [ns].
        pause_s: Wanted pause [s].
    """
    now_ns = time.monotonic_ns() - words[Word.OFFSET_NS]
    ended_ns = words[Word.HEARTBEAT_NS]
    pause_ns = round(pause_s * 1e9)
    if abs(now_ns - ended_ns) <= _SILENT * period_ns:
        pause_ns += (ended_ns + _SETTLED_NS - now_ns - pause_ns) % period_ns
    return pause_ns * 1e-9
