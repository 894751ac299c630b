"""A servo simulated in the controller's own process, behind the servo interface.

It models the same as ``haptic_wall.hw.plant.mechanism``: inertia, friction at rest and in motion,
a weight, cogging, a load behind a flexible transmission, a scripted operator, the encoder's
rounding, errors and backlash, saturation, torque steps, a lag between sending a torque and its
action, a loop of current control, and back-EMF. It does *not* model a bus (no reply is ever late or
lost, and reading and writing take no time), a current sensor, or temperature.
"""

from __future__ import annotations

import math

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.servo import Bus, Check, Facts, Outcome, Reading
from haptic_wall.hw.truth import TrueServo

GRAIN_NS = 1000
"""Resolution of the motion in real time [ns]: steps of equal length repeat, and their responses are
cached. A loop cannot notice it."""


class SimulatedServo:
    """A servo whose motion is computed on each access."""

    facts: Facts
    bus: Bus | None

    def __init__(self, true: TrueServo, clock: Clock) -> None:
        """Open it; its time begins with ``start``."""
        self._true = true
        self._now_ns = clock.now_ns
        self._written: float | None = None
        """The last torque and its time [ns], applied when time advances"""
        self._written_ns = 0
        self._grain_ns = 1 if isinstance(clock, SimulatedClock) else GRAIN_NS
        self._mechanism = Mechanism(true, self._instant())
        self._hand: SharedHand | None = None
        self._reading: Reading | None = None
        self._running = False
        self.bus = None
        self.facts = Facts(
            name="simulated servo",
            counts_per_rev=true.counts_per_rev,
            torque_limit=true.torque_limit,
            torque_step=true.torque_step,
            stall_torque=true.torque_limit,
        )

    def start(self) -> list[Check]:
        """Start its time; there is nothing to check."""
        now_ns = self._instant()
        self._mechanism = Mechanism(self._true, now_ns, operator_waits=True)
        self._mechanism.engage_operator(now_ns)
        if self._hand is not None:
            self._mechanism.take_hand(self._hand)
        self._reading = self._written = None
        self._running = True
        return []

    def request(self) -> None:
        """Sample the position now."""
        now_ns = self._now_ns()
        self._pass_until(now_ns - now_ns % self._grain_ns)
        position, counts = self._mechanism.measured()
        self._reading = Reading(Outcome.OK, position, counts, now_ns, math.nan, False)

    def collect(self, deadline_ns: int) -> Reading:  # noqa: ARG002 - nothing to wait for
        """Return the sample of the last ``request``, without waiting.

        Raises:
            RuntimeError: There was no request.
        """
        reading = self._reading
        if reading is None:
            raise RuntimeError("a reading was collected without a request; call request first")
        self._reading = None
        return reading

    def write(self, torque: float) -> float:
        """Command a torque [N·m].

        Returns:
            The torque after limit and rounding [N·m].

        Raises:
            ValueError: The torque is not a finite number.
            RuntimeError: The servo is not started.
        """
        if not self._running:
            raise RuntimeError("a torque was written while torque is off; call start first")
        acting = self._mechanism.limited(torque)
        now_ns = self._instant()
        if self._written is not None:  # the last torque acted until now
            self._pass_until(now_ns)
        self._written, self._written_ns = acting, now_ns
        return acting

    def stop(self) -> bool:
        """Switch torque off; the servo moves on by itself. Always succeeds."""
        if self._running:
            self._pass_until(self._instant())
            self._mechanism.release(self._mechanism.time_ns)
            self._running = False
        return True

    def close(self) -> None:
        """Stop it if it runs."""
        self.stop()

    def take_hand(self, hand: SharedHand) -> None:
        """Let a person hold the shaft from now on, whenever the hand holds on."""
        self._hand = hand
        self._mechanism.take_hand(hand)

    def _pass_until(self, now_ns: int) -> None:
        """Move until ``now_ns`` [ns], with the last torque."""
        mechanism = self._mechanism
        if self._written is not None:
            mechanism.take(self._written, self._written_ns)
            self._written = None
        mechanism.advance(now_ns)

    def _instant(self) -> int:
        now_ns = self._now_ns()
        return now_ns - now_ns % self._grain_ns
