"""Runs a loop of ``loop_rate_limiters``, in a process of its own, that only wakes up.

Its arguments are the number of wake-ups and its parent; it prints the lateness of each wake-up on
one line. It imports little, so that a round starts quickly.
"""

from __future__ import annotations

import importlib
import json
import signal
import sys
import time
from typing import Any, Final

from haptic_wall.controller.runtime import realtime

PERIOD_NS: Final = 1_000_000


def rate_limited(ticks: int) -> dict[str, Any]:
    """Use ``RateLimiter``.

    Args:
        ticks: Number of wake-ups, >= 1.

    Returns:
        ``lateness_ns`` of each, against its own announced tick, and ``elapsed_ns`` from the first
        wake-up to the last.
    """
    limiter = importlib.import_module("loop_rate_limiters").RateLimiter(
        frequency=1e9 / PERIOD_NS, warn=False
    )
    now, late = time.perf_counter, []
    first = woke = 0.0
    for _ in range(ticks):
        due = limiter.next_tick
        limiter.sleep()
        woke = now()
        first = first or woke
        late.append(round(1e9 * (woke - due)))
    return {"lateness_ns": late, "elapsed_ns": round(1e9 * (woke - first))}


def main() -> None:
    """Run the loop."""
    ticks, parent = map(int, sys.argv[1:])
    realtime.die_with_parent(parent, signal.SIGTERM)
    realtime.freeze_garbage()
    sys.stdout.write(json.dumps(rate_limited(ticks)) + "\n")


if __name__ == "__main__":
    main()
