"""Polls the health of running servos: torque enable, Bus Watchdog, supply and temperature.

Every 200 ms the request for a sample reads a wider block, which also contains these registers. This
needs no additional request, but its bytes delay the torque of that period. Baud rate and period
limit the width; if no block can contain all registers, two blocks alternate.

Goals are never answered, so a servo without torque looks like one with zero torque. A separate read
would cost a period with an adapter timer of 1 ms, and would collide with a pipelined sample. The
longer replies cost 28 to 168 µs at 4 Mbit/s. Indirect addresses would be shorter, but if another
program changes them, a wrong register becomes the position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.samples import LENGTHS, SAMPLE_ADDRESS, SAMPLE_END, Way
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.dynamixel.wire import (
    EMPTY_REPLY_BYTES,
    JOINT_HEAD_BYTES,
    JOINT_PART_BYTES,
    READ_REQUEST_BYTES,
)
from haptic_wall.hw.errors import Problem, ServoError

EVERY_NS: Final = 200_000_000
"""Period of the polls"""
_SHARE: Final = 0.65
"""Largest fraction of a period for a wide request and its reply on the wire: a goal follows, and
after 0.8 a reply is given up"""
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

    watchdog: int
    """Setting of Bus Watchdog [20 ms]"""
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

    def supply_fault(self, volts: int) -> Problem | None:
        """Return the fault of a supply voltage [0.1 V]; None if it is in range."""
        if self.lowest <= volts <= self.highest:
            return None
        return Problem(
            f"is supplied with {volts / 10:g} V, wanted {self.lowest / 10:g} to "
            f"{self.highest / 10:g} V",
            advice="check the supply, its current limit and the cable.",
            mark=ServoError.mark,
        )

    def heat_fault(self, celsius: int) -> Problem | None:
        """Return the fault of a temperature [°C]; None if it is low enough."""
        if celsius <= self.warmest:
            return None
        return Problem(
            f"has {celsius} °C, wanted at most {self.warmest} °C (it shuts down above "
            f"{self.hottest} °C)",
            advice="let it cool, and ask for less torque.",
            mark=ServoError.mark,
        )


class HealthPolls:
    """Decides which request asks for a wider block.

    Args:
        exchange: Reads the servos, in its present way; the lengths of the blocks are registered
            with it.
        baud: The bus's rate [bit/s].
        period_s: Period of the loop [s].
    """

    def __init__(self, exchange: Exchange, baud: int, period_s: float) -> None:
        count = len(exchange.stations)
        most = int(_SHARE * period_s * baud / 10) - READ_REQUEST_BYTES - (count if count > 1 else 0)
        if exchange.way is Way.FAST:
            most = (most - JOINT_HEAD_BYTES) // count - JOINT_PART_BYTES
        else:
            most = most // count - EMPTY_REPLY_BYTES
        blocks = next(
            (way for way in _BLOCKS if all(end - address <= most for address, end in way)), ()
        )
        self._lengths = [
            end - address if end - address in LENGTHS else exchange.widen(address, end)
            for address, end in blocks
        ]
        self._wanted = {
            end - address: [
                (name, register.address - address, register.size)
                for name, found in _ITEMS.items()
                if address <= (register := REGISTERS[found]).address < end
            ]
            for address, end in blocks
        }
        self._turn = self._next = 0  # places in the list of lengths
        self.asked = 0
        """Length of the block in the last request; 0: the sample only"""
        self.due_ns = 0
        """Time of the next poll [ns]"""

    def describe(self) -> tuple[str, str]:
        """Describe the watched values with their interval; also list all that could be watched."""
        everything = ", ".join(_ITEMS)
        seen = {name for turn in self._wanted.values() for name, *_ in turn}
        if not seen:
            return "nothing: this bus has no time left at this rate", everything
        names = ", ".join(name for name in _ITEMS if name in seen)
        return f"{names} every {EVERY_NS * len(self._lengths) * 1e-9:g} s", everything

    def length(self, now_ns: int) -> int:
        """Return the length of the block to request at ``now_ns`` [ns]; 0: the sample only."""
        self.due_ns = now_ns + EVERY_NS
        if self._lengths:
            self._turn = self._next
            self.asked = self._lengths[self._turn]
        return self.asked

    def values(self, block: bytes) -> dict[str, int]:
        """Return the watched values in a reply to the last request; empty if that was no poll."""
        if len(block) != self.asked:
            return {}
        wanted = self._wanted[self.asked]
        return {name: int.from_bytes(block[at : at + size], "little") for name, at, size in wanted}

    def answered(self) -> None:
        """Go on to the next block with the next poll; an unanswered one is repeated."""
        self._next = (self._turn + 1) % len(self._lengths)
