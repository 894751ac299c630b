"""Measures how long a bus takes to reply, independent of the loop's time limit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.wire import Read
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Outcome

_PATIENCE_NS: Final = 60_000_000
_RUNS: Final = 2
"""Of which the better one counts: a stall of the machine delays a few reads of one"""


@dataclass(frozen=True, slots=True)
class Replies:
    """Times until all servos have replied."""

    took_ns: list[int]
    """Sent at all phases [ns], in order of size"""
    in_row_ns: int
    """The median of those sent right after the reply before [ns]"""
    asked: int
    """Reads of all runs"""
    lost: int
    """Of all runs"""
    corrupt: int
    """Of all runs"""
    count: int = 1
    """Number of servos"""
    read: Read = "plain"
    """How they were read"""

    @property
    def share_failed(self) -> float:
        """Return the fraction of failed reads."""
        return (self.lost + self.corrupt) / self.asked


def percentile(ordered: list[int], share: float) -> int:
    """Return a percentile of sorted numbers: that fraction of them is not above it.

    Args:
        ordered: At least one.
        share: E.g. 0.99.
    """
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


def time_replies(
    line: Line, ids: Sequence[int], count: int, period_ns: int, read: Read = "plain"
) -> Replies:
    """Read the servos, and wait for all replies.

    Args:
        line: The bus.
        ids: The servos.
        count: Number of reads spread over the phases; a quarter as many follow in sequence.
        period_ns: Period of the phases [ns].
        read: How they are read.

    Raises:
        ServoLostError: The port is gone.
    """
    timer = _Stopwatch(line, ids, read)
    step_ns = round(period_ns * 0.6180339887)  # the golden ratio spreads them evenly
    best: list[int] = []
    in_row: list[int] = []
    for _ in range(_RUNS):
        spread = timer.run(number * step_ns % period_ns for number in range(count))
        if not spread:
            break
        in_row = timer.run([0] * max(1, count // 4)) or in_row
        if not best or percentile(spread, 0.99) < percentile(best, 0.99):
            best = spread
    return Replies(
        best,
        percentile(in_row, 0.5) if in_row else 0,
        timer.asked,
        timer.failures[Outcome.LOST],
        timer.failures[Outcome.CORRUPT],
        len(ids),
        read,
    )


class _Stopwatch:
    def __init__(self, line: Line, ids: Sequence[int], read: Read) -> None:
        self.asked = 0
        self.failures = {Outcome.LOST: 0, Outcome.CORRUPT: 0}
        self._exchange = Exchange(line, ids)
        self._exchange.select(self._exchange.stations, read)
        self._clock = line.clock

    def run(self, pauses_ns: Iterable[int]) -> list[int]:
        """Return the sorted durations of reads, each sent a pause after the last one's end."""
        clock, exchange = self._clock, self._exchange
        took = []
        for pause_ns in pauses_ns:
            clock.wait_until(clock.now_ns() + pause_ns)
            sent_ns = clock.now_ns()
            exchange.request()
            samples = exchange.collect(sent_ns + _PATIENCE_NS)
            self.asked += 1
            worst = max(sample.outcome for sample in samples)
            if worst is Outcome.OK:
                took.append(clock.now_ns() - sent_ns)
            else:
                self.failures[worst] += 1
        return sorted(took)
