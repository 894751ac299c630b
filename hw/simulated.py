"""Servos simulated in the controller's own process, behind the interface of a bus.

It models the same as ``haptic_wall.hw.plant.mechanism``: inertia, friction at rest and in motion,
a weight, cogging, a load behind a flexible transmission, a scripted operator, the encoder's
rounding, errors and backlash, saturation, torque steps, a lag between sending a torque and its
action, a loop of current control, and back-EMF. It does *not* model a bus (no reply is ever late or
lost, and reading and writing take no time), a current sensor, or temperature.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.plant.arm import couple
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.servo import Check, Facts, Outcome, Reading
from haptic_wall.hw.truth import TrueArm, TrueServo

GRAIN_NS = 1000
"""Resolution of the motion in real time [ns]: steps of equal length repeat, and their responses are
cached. A loop cannot notice it."""


class SimulatedBus:
    """Servos whose motion is computed on each access.

    Args:
        trues: The servos.
        clock: Their time, which begins with ``start``.
        arm: The links between them; None: there are none.

    Raises:
        SpecError: They cannot be the joints of this arm.
    """

    traffic = None
    trouble = ""

    def __init__(
        self, trues: Sequence[TrueServo], clock: Clock, arm: TrueArm | None = None
    ) -> None:
        self._trues = trues
        self._arm = arm
        self._now_ns = clock.now_ns
        self._grain_ns = 1 if isinstance(clock, SimulatedClock) else GRAIN_NS
        self._mechanisms = [Mechanism(true, self._instant()) for true in trues]
        couple(arm, self._mechanisms)
        self._hands: list[SharedHand] = []
        self._readings: list[Reading] = []
        self._running = False
        self.given_up: Callable[[], bool] = lambda: False
        self.facts = [
            Facts(
                name="simulated servo",
                counts_per_rev=true.counts_per_rev,
                torque_limit=true.torque_limit,
                torque_step=true.torque_step,
                stall_torque=true.torque_limit,
            )
            for true in trues
        ]

    def health(self) -> list[tuple[float, float]]:
        """Return nothing: they have no supply and no temperature."""
        return []

    def start(self) -> list[list[Check]]:
        """Start their time; there is nothing to check."""
        now_ns = self._instant()
        self._mechanisms = [Mechanism(true, now_ns) for true in self._trues]
        couple(self._arm, self._mechanisms)
        for mechanism in self._mechanisms:
            mechanism.engage_operator(now_ns)
        for mechanism, hand in zip(self._mechanisms, self._hands, strict=False):
            mechanism.take_hand(hand)
        self._readings = []
        self._running = True
        return [[] for _ in self._mechanisms]

    def request(self) -> None:
        """Sample the positions now."""
        now_ns = self._now_ns()
        self._readings = []
        for mechanism in self._mechanisms:
            mechanism.advance(now_ns - now_ns % self._grain_ns)
            position, counts = mechanism.measured()
            self._readings.append(Reading(Outcome.OK, position, counts, now_ns, math.nan, False))

    def collect(self, deadline_ns: int) -> list[Reading]:  # noqa: ARG002 - nothing to wait for
        """Return the samples of the last ``request``, without waiting.

        Raises:
            RuntimeError: There was no request.
        """
        readings, self._readings = self._readings, []
        if not readings:
            raise RuntimeError("a reading was collected without a request; call request first")
        return readings

    def write(self, torques: Sequence[float]) -> list[float]:
        """Command a torque to each [N·m].

        Returns:
            The torques after limit and rounding [N·m].

        Raises:
            ValueError: A torque is not a finite number.
            RuntimeError: The bus is not started.
        """
        if not self._running:
            raise RuntimeError("a torque was written while torque is off; call start first")
        acting = [
            mechanism.limited(torque)
            for mechanism, torque in zip(self._mechanisms, torques, strict=True)
        ]
        now_ns = self._instant()
        for mechanism, torque in zip(self._mechanisms, acting, strict=True):
            mechanism.take(torque, now_ns)
        return acting

    def stop(self) -> bool:
        """Switch the torques off; the servos move on by themselves. Always succeeds."""
        if self._running:
            now_ns = self._instant()
            for mechanism in self._mechanisms:
                mechanism.release(now_ns)
            self._running = False
        return True

    def close(self) -> None:
        """Stop if they run."""
        self.stop()

    def take_hand(self, hand: SharedHand) -> None:
        """Let a person hold the shafts from now on, whenever the hand holds on."""
        self._hands = [hand.of(axis) for axis in range(len(self._mechanisms))]
        for mechanism, own in zip(self._mechanisms, self._hands, strict=True):
            mechanism.take_hand(own)

    def _instant(self) -> int:
        now_ns = self._now_ns()
        return now_ns - now_ns % self._grain_ns
