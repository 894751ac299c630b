"""The moving servo in time: torques that act late, a hand, and an encoder with play.

Made of ``haptic_wall.hw.plant.body`` between the instants at which something changes: a torque
begins to act, or the hand's reference turns. Times are integer nanoseconds of whatever clock the
caller has.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from haptic_wall.hw.plant.body import PlantParameters, Pull, State, step
from haptic_wall.hw.plant.hand import DAMPING, STIFFNESS, hand_of
from haptic_wall.hw.settings import TrueServo

HAND_WAIT_S = 1.0
"""How long a hand that waits goes on waiting once it may come [s]"""


class Mechanism:
    """One servo, its motor side commanded in torque, its encoder read.

    The encoder rounds to the nearest count and counts on over turns. With backlash it follows
    the shaft as a play of that full width does, starting in the middle: the turning points of
    the shaft within a step count.
    """

    __slots__ = (
        "_backlash",
        "_braking",
        "_counts_per_radian",
        "_delay_ns",
        "_followed",
        "_hand",
        "_hand_ns",
        "_parameters",
        "_pending",
        "_start_ns",
        "_state",
        "_torque",
        "_torque_limit",
        "_torque_step",
        "_true",
        "time_ns",
    )

    def __init__(self, true: TrueServo, start_ns: int, *, hand_waits: bool = False) -> None:
        """A servo at rest at ``true.position``, with no torque, at ``start_ns`` [ns].

        Args:
            true: What it is.
            start_ns: Present time [ns].
            hand_waits: The scripted hand keeps off until ``let_hand``.

        Raises:
            ValueError: A value is out of range.
        """
        self._parameters = PlantParameters(true.inertia, true.damping, true.coulomb)
        self._braking = 0.0
        self._state = State(true.position, 0.0)
        self._true = true
        self._hand = None if hand_waits else hand_of(true)
        self._hand_ns: int | None = None
        self._start_ns = start_ns
        self._delay_ns = round(true.delay * 1e9)
        if self._delay_ns < 0:
            raise ValueError(f"delay is {true.delay} s; give a value from 0 up")
        if not true.torque_limit > 0.0:
            raise ValueError(f"torque_limit is {true.torque_limit} N·m; give a value above 0")
        self._torque_limit = true.torque_limit
        self._torque_step = true.torque_step
        self._torque = 0.0
        self._pending: deque[tuple[int, float, float]] = deque()
        self._counts_per_radian = true.counts_per_rev / (2.0 * math.pi)
        self._backlash = true.backlash
        self._followed = true.position
        self.time_ns = start_ns

    @property
    def position(self) -> float:
        """True position of the shaft [rad], at the time last advanced to."""
        return self._state.position

    @property
    def velocity(self) -> float:
        """True velocity of the shaft [rad/s], at the time last advanced to."""
        return self._state.velocity

    @property
    def torque(self) -> float:
        """The motor's torque that acts [N·m], from the time last advanced to."""
        return self._torque - self._braking * self._state.velocity

    def let_hand(self, now_ns: int) -> None:
        """Let the scripted hand take the shaft, wherever it is, ``HAND_WAIT_S`` after ``now_ns``.

        That is for whoever renders a wall: a person too waits until the servo is ready.
        """
        self.advance(now_ns)
        self._hand_ns = now_ns + round(HAND_WAIT_S * 1e9)

    def advance(self, now_ns: int) -> None:
        """Let time pass until ``now_ns`` [ns].

        Raises:
            ValueError: ``now_ns`` lies before the time last advanced to.
        """
        if now_ns < self.time_ns:
            raise ValueError(
                f"time went back from {self.time_ns} to {now_ns} ns; advance in order of time"
            )
        pending = self._pending
        while pending and pending[0][0] <= now_ns:
            acts_ns, torque, braking = pending.popleft()
            if acts_ns > self.time_ns:
                self._move(acts_ns)
            self._torque = torque
            self._brake(braking)
        if now_ns > self.time_ns:
            self._move(now_ns)

    def command(self, torque: float, now_ns: int, braking: float = 0.0) -> float:
        """Command a torque that arrives at ``now_ns`` [ns] and acts the servo's delay later.

        Args:
            torque: Wanted [N·m]. Limited to the servo's limit, then rounded to its step (toward
                zero where the nearest step would pass the limit).
            now_ns: When the command arrives; time is advanced to it.
            braking: What the torque loses with the velocity, as that of a motor under a held
                voltage does [N·m·s/rad]; it acts along with the torque and is not limited.

        Returns:
            The torque that will act [N·m].

        Raises:
            ValueError: The torque is not a finite number, or ``now_ns`` lies in the past.
        """
        acting = self.limited(torque)
        self.advance(now_ns)
        if self._delay_ns == 0:
            self._torque = acting
            self._brake(braking)
        else:
            self._pending.append((now_ns + self._delay_ns, acting, braking))
        return acting

    def limited(self, torque: float) -> float:
        """Torque that a command for ``torque`` makes, within the limit and in whole steps [N·m].

        Raises:
            ValueError: The torque is not a finite number.
        """
        if not math.isfinite(torque):
            raise ValueError(f"torque is {torque}; command a finite number of N·m")
        limit, step_size = self._torque_limit, self._torque_step
        acting = min(max(torque, -limit), limit)
        if step_size > 0.0:
            steps = round(acting / step_size)
            acting = steps * step_size
            if abs(acting) > limit:
                acting = (steps - int(math.copysign(1, steps))) * step_size
        return acting

    def encoder(self) -> int:
        """Counts of the encoder, rounded to the nearest, multi-turn.

        Raises:
            ValueError: The servo has no encoder (counts_per_rev is 0).
        """
        if self._counts_per_radian == 0.0:
            raise ValueError("counts_per_rev is 0, so nothing is counted; read measured_position")
        return round(self._followed * self._counts_per_radian)

    def measured_position(self) -> float:
        """The position the encoder gives [rad]: past the play, and quantised if it counts."""
        return self.measured()[0]

    def measured(self) -> tuple[float, int]:
        """The same, and what the encoder counts; 0 where it counts nothing."""
        per_radian = self._counts_per_radian
        if per_radian == 0.0:
            return self._followed, 0
        counts = round(self._followed * per_radian)
        return counts / per_radian, counts

    def _brake(self, braking: float) -> None:
        if braking != self._braking:
            self._braking = braking
            true = self._true
            self._parameters = PlantParameters(true.inertia, true.damping + braking, true.coulomb)

    def _move(self, until_ns: int) -> None:
        """Move under the torque that acts, cutting where the hand comes or its reference turns."""
        if self._hand_ns is not None and until_ns >= self._hand_ns:
            begin_ns, self._hand_ns = self._hand_ns, None
            if begin_ns > self.time_ns:
                self._move(begin_ns)
            self._hand = hand_of(replace(self._true, position=self.position))
            self._start_ns = begin_ns
            if until_ns == begin_ns:
                return
        turns: list[float] | None = [] if self._backlash > 0.0 else None
        state, parameters, torque, hand = self._state, self._parameters, self._torque, self._hand
        now_ns, start_ns = self.time_ns, self._start_ns
        if hand is None:
            state = step(state, parameters, torque, (until_ns - now_ns) * 1e-9, turns=turns)
        else:
            while now_ns < until_ns:
                reference, slope, turn_ns = hand.pull(now_ns - start_ns)
                cut_ns = min(until_ns, start_ns + turn_ns)
                pull = Pull(STIFFNESS, DAMPING, reference, slope)
                state = step(state, parameters, torque, (cut_ns - now_ns) * 1e-9, pull, turns=turns)
                now_ns = cut_ns
        self._state = state
        self.time_ns = until_ns
        if turns is None:
            self._followed = state.position
        else:
            half = 0.5 * self._backlash
            for position in (*turns, state.position):
                self._followed = min(max(self._followed, position - half), position + half)
