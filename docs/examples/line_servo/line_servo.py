"""A servo backend for haptic-wall: a motor board that speaks one line of text an exchange.

E 1        torque on; answered by E 1, and E 0 by E 0
T 250      torque of 0.250 N·m; not answered
P 17       where is the shaft?; answered by P 17 COUNTS, with the same number
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from haptic_wall.hw.backend import Backend
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.errors import ServoLostError, ServoMissingError
from haptic_wall.hw.serialport.line import FdLine, Line
from haptic_wall.hw.serialport.port import open_port
from haptic_wall.hw.servo import BusCounts, Check, Facts, Outcome, Reading, Traffic
from haptic_wall.hw.settings import ServoSettings

COUNTS_PER_REV = 16384
"""Counts per revolution of the encoder on the board's shaft"""
MOST_TORQUE = 1.0
"""The largest torque that the motor can make [N·m]"""
ANSWER_NS = 500_000_000
"""How long the board may take to switch its torque [ns]"""


class LineServo:
    """A bus of one servo."""

    def __init__(self, settings: ServoSettings, line: Line) -> None:
        self.traffic = Traffic([BusCounts()])
        facts = Facts(
            name=f"line servo on {settings.port}",
            counts_per_rev=COUNTS_PER_REV,
            torque_limit=min(settings.torque_limit or math.inf, MOST_TORQUE),
            torque_step=0.001,
        )
        self.facts = [facts]
        self._line = line
        self._now_ns = line.clock.now_ns
        self._unread = b""
        self._asked = self._asked_ns = 0
        self._running = False

    def start(self) -> list[list[Check]]:
        if not self._switch("1"):
            raise ServoMissingError(
                f"The {self.facts[0].name} does not answer", advice="check the cable."
            )
        self.traffic.counts = [BusCounts()]
        self._running = True
        return [[Check("torque", True, "on, at zero", "on, at zero")]]

    def request(self) -> None:
        # The number tells the answer from one that was given up: it may still come.
        self._asked += 1
        self._asked_ns = self._now_ns()
        self._line.write(b"P %d\n" % self._asked)

    def collect(self, deadline_ns: int) -> list[Reading]:
        traffic, began_ns = self.traffic, self._now_ns()
        traffic.counts[0].cycles += 1
        outcome, counts = self._answer(deadline_ns)
        traffic.waited_ns = self._now_ns() - began_ns
        position = counts * self.facts[0].position_step if outcome is Outcome.OK else math.nan
        return [Reading(outcome, position, counts, self._asked_ns, math.nan, False)]

    def write(self, torques: Sequence[float]) -> list[float]:
        (torque,) = torques
        if not self._running:
            raise RuntimeError("a torque was written while torque is off; call start first")
        if not math.isfinite(torque):
            raise ValueError(f"a torque of {torque} N·m was commanded; a finite one is wanted")
        most = math.floor(1000.0 * self.facts[0].torque_limit)
        thousandths = max(-most, min(most, round(1000.0 * torque)))
        self._line.write(b"T %d\n" % thousandths)
        return [thousandths / 1000.0]

    def stop(self) -> bool:
        self._running = False
        try:
            return self._switch("0")
        except ServoLostError:
            return False

    def close(self) -> None:
        if self._running:
            self.stop()
        self._line.close()

    def _switch(self, state: str) -> bool:
        """Torque on or off, from zero; whether the board has confirmed it."""
        self._line.write(f"T 0\nE {state}\n".encode())
        deadline_ns = self._now_ns() + ANSWER_NS
        while True:
            if any(words == ["E", state] for words in self._lines()):
                return True
            if not self._line.wait(deadline_ns):
                return False

    def _answer(self, deadline_ns: int) -> tuple[Outcome, int]:
        counts = self.traffic.counts[0]
        while True:
            for words in self._lines():
                try:
                    _, number, position = words
                    mine, found = int(number) == self._asked, int(position)
                except ValueError:
                    counts.corrupt += 1
                    return Outcome.CORRUPT, 0
                if mine:
                    return Outcome.OK, found
                counts.late += 1
            if not self._line.wait(deadline_ns):
                counts.lost += 1
                return Outcome.LOST, 0

    def _lines(self) -> list[list[str]]:
        """The words of each whole line that has arrived."""
        *lines, self._unread = (self._unread + self._line.read()).split(b"\n")
        return [line.decode(errors="replace").split() for line in lines]


def _open_port(servos: Sequence[ServoSettings]) -> int:
    return open_port(servos[0].port, servos[0].baud)


def _open(servos: Sequence[ServoSettings], clock: Clock, descriptor: int | None) -> LineServo:
    return LineServo(
        servos[0], FdLine(_open_port(servos) if descriptor is None else descriptor, clock)
    )


def _cut_torque(servos: Sequence[ServoSettings], descriptor: int | None, clock: Clock) -> bool:
    return descriptor is not None and LineServo(servos[0], FdLine(descriptor, clock)).stop()


BACKEND = Backend(
    open=_open,
    has_bus=True,
    required={"port": "the board's serial device", "baud": "115200, as the board is set"},
    open_port=_open_port,
    cut_torque=_cut_torque,
)
