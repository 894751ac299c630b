"""The highest rate at which a loop keeps up with the emulated bus, beside a bare loop."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Final

from haptic_wall.controller.bench.loops import LOOPS, Loop, Ran, emulated_bus
from haptic_wall.controller.bench.rows import Section, over_rounds
from haptic_wall.hw.errors import ServoError

_LOW_HZ, _HIGH_HZ = 500.0, 5500.0
"""At the most a cycle takes 0.8 of a period on the wire alone"""
_ROUNDS, _STEPS, _TRIES, _SECONDS = 5, 6, 2, 0.8
"""The last step decides on 4 %; a rate is tried again, since the machine stalls at times"""
_MOST_FAILED = 0.01
_WHAT: Final = "highest rate with under 1 % of the periods skipped or without their own reply"
_SHOWS_NOT: Final = (
    "a wire and a USB adapter, which allow less; most of a period passes on the emulated wire at"
    " 4 Mbit/s and in the emulated bus's own process"
)


class Search:
    """Halves, on a logarithmic scale, the range in which the highest rate lies.

    Args:
        low_hz: Rates below it are not of interest.
        high_hz: Rates above it are not either.

    Attributes:
        held_hz: The highest rate that was held; None: none was.
        rate_hz: The next one to be tried.
    """

    def __init__(self, low_hz: float, high_hz: float) -> None:
        self._low, self._high = low_hz, high_hz
        self.held_hz: float | None = None

    @property
    def rate_hz(self) -> float:
        """See ``Search``."""
        return math.sqrt(self._low * self._high)

    def tell(self, held: bool) -> None:
        """Take the result at ``rate_hz`` into account."""
        if held:
            self._low = self.held_hz = self.rate_hz
        else:
            self._high = self.rate_hz


def measure() -> Section:
    """The highest rate of each loop, and of one over that of the other.

    Raises:
        PlatformError: The bus or a loop could not be started.
    """
    held: dict[str, list[float]] = {name: [] for name in LOOPS}
    notes = []
    with emulated_bus() as path:
        for number in range(_ROUNDS):
            searches = {name: Search(_LOW_HZ, _HIGH_HZ) for name in LOOPS}
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
    rows.append(over_rounds(name, ratios, "1", "how fast either is; that stands above"))
    return Section(tuple(rows), tuple(notes))


def holds(loop: Loop, path: str, rate_hz: float) -> bool:
    """Whether a loop keeps up with a rate, in one of a few tries.

    One that does not even start does not: what a loop before it has asked for at a rate that was
    too high may still be in the bus.

    Args:
        loop: To be tried.
        path: Of the bus.
        rate_hz: To be kept up with.
    """
    for _ in range(_TRIES):
        with suppress(ServoError):
            if kept_up(loop(path, _SECONDS, rate_hz)):
                return True
    return False


def kept_up(ran: Ran) -> bool:
    """Whether fewer than 1 % of the periods were skipped, or without a reply."""
    return ran.missed + ran.lost < _MOST_FAILED * (ran.ticks + ran.missed)
