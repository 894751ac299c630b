"""Measures the highest rate of each loop on an emulated bus, and what six servos cost at 500 Hz."""

from __future__ import annotations

from typing import Final

from haptic_wall.controller.bench.bare_loop import PERCENTILES
from haptic_wall.controller.bench.loops import LOOPS, Loop, Turn, emulated_bus
from haptic_wall.controller.bench.rows import Measurement, Section, compared
from haptic_wall.hw.errors import ServoError

_ROUNDS, _SECONDS = 3, 1.5
_RATES_HZ: Final = [round(1000.0 * 2.0 ** (step / 8)) for step in range(-4, 21)]
"""Tried, in steps of 9 % [Hz]"""
_MOST_SKIPPED: Final = 0.01
"""Largest fraction of periods without a cycle at a rate that a loop holds"""
_TRIES: Final = 2
"""One of them is enough: a stall of the machine says nothing of the loop"""
_SIX, _SIX_HZ, _SIX_SECONDS, _SIX_ROUNDS = 6, 500.0, 4.0, 7


def measure() -> Section:
    """Measure both; the ratios to the bare loop too.

    Raises:
        ServoError: A servo could not be started.
        PlatformError: The bus or a loop could not be started.
    """
    return Section((*_highest(), *_six()))


def _highest() -> list[Measurement]:
    """Find the highest rate that each loop holds."""
    rates: dict[str, list[float]] = {name: [] for name in LOOPS}
    with emulated_bus() as path:
        for _ in range(_ROUNDS):
            for name, loop in LOOPS.items():
                rates[name].append(highest_rate_hz(loop, path))
    what = f"highest rate with at most {_MOST_SKIPPED:.0%} of the periods skipped"
    return compared(what, rates, "Hz")


def highest_rate_hz(loop: Loop, path: str) -> float:
    """Return the highest of the rates that a loop holds [Hz], by bisection; at least the lowest."""
    low, high = 0, len(_RATES_HZ)
    while high - low > 1:
        middle = (low + high) // 2
        if any(_holds(loop, path, _RATES_HZ[middle]) for _ in range(_TRIES)):
            low = middle
        else:
            high = middle
    return float(_RATES_HZ[low])


def _holds(loop: Loop, path: str, rate_hz: float) -> bool:
    """Return whether a loop holds a rate; one may be refused, because replies are too slow."""
    try:
        skipped = loop(path, _SECONDS, rate_hz, 1).skipped
    except ServoError:
        return False
    return skipped <= _MOST_SKIPPED * _SECONDS * rate_hz


def _six() -> list[Measurement]:
    """Measure the work of a cycle with six servos."""
    turns: dict[str, list[Turn]] = {name: [] for name in LOOPS}
    servos = [f"XM430-W350:{id_}" for id_ in range(1, _SIX + 1)]
    with emulated_bus(servos=servos) as path:
        for _ in range(_SIX_ROUNDS):
            for name, loop in LOOPS.items():
                turns[name].append(loop(path, _SIX_SECONDS, _SIX_HZ, _SIX))
    rows = []
    for p in PERCENTILES:
        works = {name: [turn.work_us[p] for turn in each] for name, each in turns.items()}
        rows += compared(f"work of a cycle with six servos at {_SIX_HZ:g} Hz, p{p}", works, "µs")
    return rows
