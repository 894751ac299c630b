"""Finds the highest rate at which a loop keeps up with the emulated bus, beside a bare loop."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Final

from haptic_wall.controller.bench.loops import LOOPS, Loop, Ran, emulated_bus
from haptic_wall.controller.bench.rows import Section, over_rounds
from haptic_wall.hw.errors import ServoError

_LOW_HZ, _HIGH_HZ = 500.0, 5500.0
"""At the highest rate a cycle takes 0.8 of a period on the wire alone"""
_ROUNDS, _STEPS, _TRIES, _SECONDS = 5, 6, 2, 0.8
"""The last step resolves 4 %; a rate is tried twice, since the machine stalls at times"""
_MOST_FAILED = 0.01
_WHAT: Final = "highest rate with under 1 % of the periods skipped or without their own reply"
_SHOWS_NOT: Final = (
    "a wire and a USB adapter, which allow less; most of a period passes on the emulated wire at"
    " 4 Mbit/s and in the emulated bus's own process"
)


class RateSearch:
    """Bisects, on a logarithmic scale, the range of the highest rate.

    Attributes:
        held_hz: The highest rate that was held; None: none was.
        rate_hz: The next rate to try.
    """

    def __init__(self, low_hz: float, high_hz: float) -> None:
        self._low, self._high = low_hz, high_hz
        self.held_hz: float | None = None

    @property
    def rate_hz(self) -> float:
        """Return the next rate to try [Hz]."""
        return math.sqrt(self._low * self._high)

    def tell(self, held: bool) -> None:
        """Record whether ``rate_hz`` was held."""
        if held:
            self._low = self.held_hz = self.rate_hz
        else:
            self._high = self.rate_hz


def measure() -> Section:
    """Measure the highest rate of each loop, and their ratio.

    Raises:
        PlatformError: The bus or a loop could not be started.
    """
    held: dict[str, list[float]] = {name: [] for name in LOOPS}
    notes = []
    with emulated_bus() as path:
        for number in range(_ROUNDS):
            searches = {name: RateSearch(_LOW_HZ, _HIGH_HZ) for name in LOOPS}
            for _ in range(_STEPS):
                for name, loop in LOOPS.items():
                    searches[name].tell(holds(loop, path, searches[name].rate_hz))
            found = {
                name: search.held_hz
                for name, search in searches.items()
                if search.held_hz is not None
            }
            notes += [
                f"round {number + 1}, {name}: no rate above {_LOW_HZ:g} Hz was held; the machine"
                " is too busy"
                for name in LOOPS
                if name not in found
            ]
            if len(found) == len(LOOPS):
                for name, rate_hz in found.items():
                    held[name].append(rate_hz)
    if not all(held.values()):
        return Section((), tuple(notes))
    rows = [
        over_rounds(f"{name}, {_WHAT}", rates, "Hz", _SHOWS_NOT) for name, rates in held.items()
    ]
    ratios = [ours / bare for bare, ours in zip(*held.values(), strict=True)]
    name = "haptic-wall, highest rate: over that of the bare loop, in the same round"
    rows.append(over_rounds(name, ratios, "1", "the speed of either, which is listed above"))
    return Section(tuple(rows), tuple(notes))


def holds(loop: Loop, path: str, rate_hz: float) -> bool:
    """Whether a loop keeps up with a rate, in one of a few tries.

    A loop that does not start does not keep up: requests of the loop before, at too high a rate,
    may still be in the bus.
    """
    for _ in range(_TRIES):
        with suppress(ServoError):
            if kept_up(loop(path, _SECONDS, rate_hz)):
                return True
    return False


def kept_up(ran: Ran) -> bool:
    """Whether fewer than 1 % of the periods were skipped, or without a reply."""
    return ran.missed + ran.lost < _MOST_FAILED * (ran.ticks + ran.missed)
