"""Runs a wall on the simulated clock, changes it while it runs, and records the true motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.changeover import Obstacle
from haptic_wall.controller.runtime.changes import change_of
from haptic_wall.controller.runtime.handover import KnownServo, obstacle, offer, settled, withdraw
from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.runtime.session_start import Surroundings
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.changes import changed
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.hand import Grasp
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings

Array = NDArray[np.float64]


@dataclass(slots=True)
class Asked:
    """A change that was asked for."""

    tick: int
    """Row before which it was asked for"""
    before: Config
    new: Config
    number: int
    row: int = -1
    """First row with it; -1: it was not made"""
    obstacle: Obstacle = Obstacle.NONE
    """The last reason why it waited"""
    settled: bool = False
    withdrawn: bool = False


Ask = Callable[[int, Config, float], Sequence[str]]
"""From the row, the configuration and the position [rad]: changes; empty: none"""


class Holding(Protocol):
    """A hand that holds the shaft."""

    def look(self, now_ns: int) -> Grasp | None:
        """Return how it holds the shaft at a time [ns]; None: it does not."""


class _Asking:
    """Stands before a bus: asks for changes, and records the true position."""

    def __init__(self, bus: Bus, hand: ChangedRun) -> None:
        self._bus = bus
        self._hand = hand
        self.facts, self.traffic = bus.facts, bus.traffic
        self.start, self.collect, self.write = bus.start, bus.collect, bus.write
        self.stop, self.close = bus.stop, bus.close
        self.trouble, self.health, self.given_up = bus.trouble, bus.health, bus.given_up

    def request(self) -> None:
        """Request the position of the servo, and let the other side ask."""
        self._bus.request()
        self._hand.tick(self._bus._mechanisms[0].position)  # type: ignore[attr-defined]


@dataclass
class ChangedRun:
    """A run and its changes, one after the other.

    Args:
        config: Configuration at the start; its servo is simulated, on the simulated clock.
        ask: Called in each tick in which no change waits.
        wait: Longest wait of a change [ticks].
        hand: Holds the shaft; None: the hand of the configuration does.
    """

    config: Config
    ask: Ask
    wait: int = 5000
    hand: Holding | None = None
    asked: list[Asked] = field(default_factory=list)
    truth: list[float] = field(default_factory=list)
    """True position at each tick [rad]"""

    def run(self, seconds: float) -> tuple[Result, NDArray[np.void]]:
        """Run the wall; return the result, and the rows."""
        self._now = self.config
        self._telemetry = telemetry = Telemetry.create()
        result = run_session(
            self.config,
            SimulatedClock(),
            telemetry,
            seconds,
            surroundings=Surroundings(open_bus=self._open),
        )
        rows = telemetry.read(0)[0][:, 0]
        telemetry.close()
        return result, rows

    def _open(self, servos: Sequence[ServoSettings], clock: Clock, port: int | None) -> Bus:
        bus = open_bus(servos, clock, port)
        if self.hand is not None:
            bus.take_hand(self.hand)  # type: ignore[attr-defined]
        self._servo = KnownServo(bus.facts[0], None)
        return _Asking(bus, self)

    def tick(self, position: float) -> None:
        """Go on with the change at hand, or ask for one."""
        row = len(self.truth)
        self.truth.append(position)
        at_hand = self.asked[-1] if self.asked and not self.asked[-1].settled else None
        if at_hand is not None:
            words = self._telemetry.words
            outcome = settled(words, at_hand.number)
            if outcome is None:
                at_hand.obstacle = obstacle(words)[0] or at_hand.obstacle
                if row > at_hand.tick + self.wait and not at_hand.withdrawn:
                    at_hand.withdrawn = True
                    withdraw(words, at_hand.number)
                return
            at_hand.row, at_hand.settled = outcome.row, True
            if outcome.row >= 0:
                self._now = at_hand.new
        config = self._now
        sets = tuple(self.ask(row, config, position))
        if sets:
            new = changed(config, sets)
            change, _ = change_of(len(self.asked) + 1, config, new, self._servo)
            self.asked.append(Asked(row, config, new, change.number))
            offer(self._telemetry, change)


def injected(run: ChangedRun, rows: NDArray[np.void], asked: Asked) -> float:
    """Return the energy that a change gave to the true motion [J].

    That is the work of the torque behind it, less the work that the old law would have done on the
    same motion, up to the tick from which the new law alone acts; and the difference of the
    energies in both springs at the true position there. A later change is left out, also where it
    comes before that tick.

    Args:
        run: Run with the true motion.
        rows: Rows of the run.
        asked: The first change that was made: a law with memory is fed from row 0 on.
    """
    new = asked.new
    row, period = asked.row, new.period_s
    most = max(asked.before.delay.steps, new.delay.steps)
    last = row + most + 1 if most else row
    step = 2.0 * np.pi / new.servo.counts_per_rev if new.servo.counts_per_rev else 0.0
    old_law, new_law = asked.before.law(step), new.law(step)
    limit = new.servo.torque_limit or 4.1
    truth = np.array(run.truth)
    times = np.arange(truth.size, dtype=np.float64)
    lag = new.servo.delay / period

    def acting(tick: int) -> float:
        """Return the true position when the torque of a tick begins to act [rad]."""
        return float(np.interp(tick + lag, times, truth))

    def rendered(law: Law, tick: int) -> float:
        return law.torque(float(rows["position"][tick]), float(rows["velocity"][tick]))

    def gains(law: Law, tick: int) -> None:
        law.stiffness, law.damping = (float(rows[name][tick]) for name in ("stiffness", "damping"))

    for tick in range(row):
        gains(old_law, tick)
        rendered(old_law, tick)
    gains(new_law, row)
    new_law.settle(float(rows["position"][row]))
    old_ring = _ring(run, rows, row)
    before = float(rows["wall_torque"][row - 1])
    ring = old_ring.resized(new.delay.steps, before, rendered(deepcopy(old_law), row))
    work = 0.0
    for tick in range(row, last):
        would = max(-limit, min(limit, old_ring.push(rendered(old_law, tick))))
        sent = max(-limit, min(limit, ring.push(rendered(new_law, tick))))
        work += (sent - would) * (acting(tick + 1) - acting(tick))
    there = acting(last)
    return work + _held(new_law, there, limit) - _held(old_law, there, limit)


def _ring(run: ChangedRun, rows: NDArray[np.void], row: int) -> DelayRing:
    """Return the inserted delay before the first change, with the torques under way."""
    ring = DelayRing(run.config.delay.steps)
    for torque in rows["wall_torque"][:row].tolist():
        ring.push(torque)
    return ring


def _held(law: Law, position: float, limit: float) -> float:
    return law.stored(position, limit) if law.in_contact(position) else 0.0
