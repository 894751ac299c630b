"""Polls the health of running servos: torque enable, Bus Watchdog, supply and temperature.

At least twice a second the request for the samples reads a wider block of a servo, which also
contains these registers; of several servos each has its turn. This needs no additional request, but
its bytes delay the torque of that period. Baud rate, period and the adapter limit the width; if no
block can contain all registers, two blocks alternate.

Goals are never answered, so a servo without torque looks like one with zero torque. A separate read
would cost a period with an adapter timer of 1 ms, and would collide with a pipelined sample. The
longer reply costs 28 to 168 µs at 4 Mbit/s. Indirect addresses would be shorter, but if another
program changes them, a wrong register becomes the position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.samples import LENGTHS, SAMPLE_ADDRESS, SAMPLE_END
from haptic_wall.hw.dynamixel.station import Station
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.dynamixel.wire import asking_s, poll_bytes, wire_s

EVERY_NS: Final = 200_000_000
"""Period of the polls of a single servo"""
_SHARE: Final = 0.65
"""Largest fraction of a period for a wide request and its reply on the wire: a goal follows"""
_IN_TIME: Final = 0.8
"""Fraction of a period after which a reply is given up"""
_MOST_UNANSWERED: Final = 10
"""Consecutive unanswered polls of a servo that end the run"""
_HEAT_MARGIN: Final = 2
"""Distance below Temperature Limit at which the run ends, before the servo shuts down [°C]"""
_ITEMS: Final = {
    "torque enable": "torque_enable",
    "bus watchdog": "bus_watchdog",
    "supply": "present_input_voltage",
    "temperature": "present_temperature",
}
"""The watched registers by their names in messages"""
_SUPPLY_AND_HEAT: Final = (SAMPLE_ADDRESS, 147)
_BLOCKS: Final = (
    ((64, 147),),
    ((64, SAMPLE_END), _SUPPLY_AND_HEAT),
    ((98, SAMPLE_END), _SUPPLY_AND_HEAT),
    (_SUPPLY_AND_HEAT,),
)
"""Sets of alternating blocks, the most complete set first; each block as (from, to)"""


@dataclass(frozen=True, slots=True)
class DrivingRange:
    """The range in which a servo may be driven: the limits in its registers, read at the start."""

    lowest: int
    """Min Voltage Limit [0.1 V]"""
    highest: int
    """Max Voltage Limit [0.1 V]"""
    hottest: int
    """Temperature Limit [°C]"""

    @property
    def warmest(self) -> int:
        """Return the highest temperature at which the servo is driven [°C]."""
        return self.hottest - _HEAT_MARGIN

    def supply_fault(self, volts: int) -> tuple[str, str]:
        """Return the fault of a supply voltage [0.1 V], and the remedy; empty: it is in range."""
        if self.lowest <= volts <= self.highest:
            return "", ""
        wanted = f"wanted {self.lowest / 10:g} to {self.highest / 10:g} V"
        advice = "check the supply, its current limit and the cable"
        return f"is supplied with {volts / 10:g} V, {wanted}", advice

    def heat_fault(self, celsius: int) -> tuple[str, str]:
        """Return the fault of a temperature [°C], and the remedy; empty: it is low enough."""
        if celsius <= self.warmest:
            return "", ""
        wanted = f"wanted at most {self.warmest} °C (it shuts down above {self.hottest} °C)"
        return f"has {celsius} °C, {wanted}", "let it cool, and ask for less torque"


class HealthPolls:
    """Decides which request asks one servo for a wider block.

    Args:
        exchange: Reads the servos, in its present way; the blocks are registered with it.
        baud: The bus's rate [bit/s].
        period_s: Period of the loop [s].
        hold_s: Longest time for which the adapter holds a reply [s].
    """

    def __init__(self, exchange: Exchange, baud: int, period_s: float, hold_s: float = 0.0) -> None:
        self._stations = stations = exchange.stations
        self._count = count = len(stations)
        self._baud, self._period_s, self._hold_s = baud, period_s, hold_s
        self._besides = poll_bytes(count, exchange.way)
        self.longest_s = hold_s + asking_s(baud, count, exchange.way)
        if count > 1:
            address, end = _SUPPLY_AND_HEAT
            self.longest_s = hold_s + wire_s(self._besides + end - address, baud)
        """Time of all replies at the worst phase of an adapter's timer, to a poll of several [s]"""
        self.patience_s = _IN_TIME * period_s
        """Time that the loop has given the last replies [s]"""
        self._exchange = exchange
        self._reserve(self._blocks(self.patience_s))
        self._turn = 0
        """Number of the next poll: of each servo in turn, then with the next block"""
        self._unanswered = dict.fromkeys(stations, 0)
        self.asked: Station | None = None
        """The servo whose wider block the last request asks for; None: samples only"""
        self._block = _SUPPLY_AND_HEAT
        """That block"""
        self.due_ns = 0
        """Time of the next poll [ns]"""

    def describe(self) -> tuple[str, str]:
        """Describe the watched values with their interval; also list all that could be watched."""
        everything, patience_s = ", ".join(_ITEMS), _IN_TIME * self._period_s
        if self.longest_s > patience_s:  # the loop then waits for them in its next period
            patience_s += self._period_s
        blocks = self._blocks(patience_s)
        seen = {name for block in blocks for name, *_ in _items(*block)}
        if not seen:
            return "nothing: this bus has no time left at this rate", everything
        names = ", ".join(name for name in _ITEMS if name in seen)
        period_s = self._every_ns(len(blocks)) * self._count * len(blocks) * 1e-9
        return f"{names} every {period_s:.1g} s", everything

    def length(self, now_ns: int) -> int:
        """Begin a poll at ``now_ns`` [ns], of the servo ``asked``; return its block's length.

        Returns:
            0: there is no time for any, or a late reply to the last one may still come.
        """
        blocks = self._blocks(self.patience_s)
        length = 0
        if blocks:
            again, number = divmod(self._turn, self._count)
            station = self._stations[number]
            address, end = block = blocks[again % len(blocks)]
            length = end - address
            self._reserve(blocks)
            if not self._exchange.lengths.is_free(length):
                return 0
            self._turn += 1
            self._block, self.asked = block, station
            self._unanswered[station] += 1
        self.due_ns = now_ns + self._every_ns(len(blocks))
        return length

    def values(self, block: bytes) -> dict[str, int]:
        """Return the watched values in a servo's block; empty: it is none."""
        asked, (address, end) = self.asked, self._block
        if asked is None or len(block) != end - address:
            return {}
        self._unanswered[asked] = 0
        return {
            name: int.from_bytes(block[at : at + size], "little")
            for name, at, size in _items(address, end)
        }

    def silent(self, station: Station) -> bool:
        """Whether a servo has left so many polls unanswered that its health is not known."""
        return self._unanswered[station] > _MOST_UNANSWERED

    def _reserve(self, blocks: Sequence[tuple[int, int]]) -> None:
        """Keep the lengths of these blocks for polls."""
        for address, end in blocks:
            if end - address not in LENGTHS:
                self._exchange.lengths.widen(address, end)

    def _blocks(self, patience_s: float) -> Sequence[tuple[int, int]]:
        """Return the alternating blocks for which there is time; empty: for none."""
        room_s = min(_SHARE * self._period_s, patience_s - self._hold_s)
        most = int(room_s * self._baud / 10) - self._besides
        return next(
            (way for way in _BLOCKS if all(end - address <= most for address, end in way)), ()
        )

    def _every_ns(self, blocks: int) -> int:
        """Return the period of the polls [ns]: twice a second each block of each of several."""
        return EVERY_NS if self._count == 1 else 2 * EVERY_NS // (self._count * max(1, blocks))


@cache
def _items(address: int, end: int) -> Sequence[tuple[str, int, int]]:
    """Return the watched values in a block: name, offset, size."""
    return [
        (name, register.address - address, register.size)
        for name, found in _ITEMS.items()
        if address <= (register := REGISTERS[found]).address < end
    ]
