"""Simulates the moving servo in time: delayed torques, operator model, encoder with backlash.

It moves by ``haptic_wall.hw.plant.step``, or ``haptic_wall.hw.plant.two_masses`` with a load behind
a transmission, from event to event: a torque begins to act, or the operator's reference changes its
slope. Times are integer nanoseconds of the caller's clock.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from haptic_wall.hw.hand import Grasp, SharedHand
from haptic_wall.hw.plant.current_loop import CurrentLoop, Winding, drive_of
from haptic_wall.hw.plant.encoder import EncoderErrors
from haptic_wall.hw.plant.mechanics import mechanics_of
from haptic_wall.hw.plant.operator_model import FOREVER_NS, OperatorModel, held_by, operator_of
from haptic_wall.hw.plant.step import NOBODY, Hand, Kept, kept_for, move
from haptic_wall.hw.plant.two_masses import ROOM, swing
from haptic_wall.hw.truth import TrueServo

OPERATOR_WAIT_S = 1.0
"""Delay between the operator's release and its first action [s]"""
_MOST_KEPT = 256
"""Responses that are at hand"""


class Mechanism:
    """One servo: takes torque commands on its motor side and returns its encoder's readings.

    The encoder rounds to the nearest count and counts over turns. With backlash it follows the
    shaft like a backlash of that full width, starting in the middle; turning points of the shaft
    within a step count. Eccentricity and noise come on top of that. With a transmission the
    backlash is between motor and output instead, and the operator acts on the output.
    """

    def __init__(
        self,
        true: TrueServo,
        start_ns: int,
        *,
        velocity: float = 0.0,
        winding: Winding | None = None,
        operator: OperatorModel | None = None,
    ) -> None:
        """Create a servo at ``true.position``, with no torque, at ``start_ns`` [ns].

        Args:
            true: Its true parameters.
            start_ns: Present time [ns].
            velocity: Velocity of the shaft at that time, of both masses [rad/s].
            winding: Its motor; None: ``true.torque_limit`` and ``true.no_load_speed``. Only a servo
                with back-EMF has a use for it.
            operator: Moves the servo from ``start_ns`` on; the one of ``true.hand`` only does
                after ``engage_operator``.
        """
        self.mechanics = mechanics_of(true)
        self.arm: Callable[[int], None] | None = None
        """Advances this servo together with others; None: it moves by itself"""
        self.held = NOBODY
        """The operator in the present step of an arm"""
        self._braking = 0.0
        self._kept: dict[tuple[float, float, float, float], Kept] = {}
        self._x, self._v = true.position, velocity
        """State of the servo where it is rigid"""
        self._end = true.position
        """Position of the output; with ``_z`` the state with a transmission"""
        self._z = [velocity, 0.0, velocity] + [0.0] * (ROOM - 3)
        self._on_motor = true.encoder == "motor"
        self._true = true
        self._operator = operator
        self._hand: SharedHand | None = None
        self._grasp: Grasp | None = None
        self._operator_ns: int | None = None
        self._start_ns = start_ns
        self._delay_ns = round(true.delay * 1e9)
        self._torque_limit = true.torque_limit
        self._torque_step = true.torque_step
        self._torque = 0.0
        self._pending: deque[tuple[int, float | None]] = deque()
        self._counts_per_radian = true.counts_per_rev / (2.0 * math.pi)
        self._followed = true.position
        drive = drive_of(true, winding or Winding(true.torque_limit, true.no_load_speed))
        self._loop = CurrentLoop(true, drive, start_ns) if drive.acts else None
        self._stepped = self._state()
        """The state where the present step of the current loop began"""
        self._errors = EncoderErrors(true)
        self._origin_ns = start_ns
        self.time_ns = start_ns

    @property
    def position(self) -> float:
        """Return the true position of the output shaft [rad], at the present time."""
        return self._end if self.flexible else self._x

    @property
    def velocity(self) -> float:
        """Return the true velocity of the output shaft [rad/s], at the present time."""
        return self._z[2] if self.flexible else self._v

    @property
    def motor_velocity(self) -> float:
        """Return the true velocity of the motor's side [rad/s]; the shaft's where that is rigid."""
        return self._z[0] if self.flexible else self._v

    @property
    def motor_position(self) -> float:
        """Return the true position of the motor's side [rad]; the shaft's where that is rigid."""
        return self._end + self._z[1] if self.flexible else self._x

    @property
    def torque(self) -> float:
        """Return the motor's acting torque [N·m], from the present time on."""
        if self._loop is not None:
            return self._loop.torque(self.motor_velocity)
        return self._torque

    def take_hand(self, hand: SharedHand) -> None:
        """Let a person hold the shaft from now on, whenever the hand holds on.

        It does so in place of the scripted operator, on the clock of ``time_ns``.
        """
        self._hand = hand

    def engage_operator(self, now_ns: int) -> None:
        """Let the scripted operator take the shaft, ``OPERATOR_WAIT_S`` after ``now_ns`` [ns].

        A program that renders a wall calls it when the servo is ready, as a person would wait for
        that.
        """
        self.advance(now_ns)
        self._operator_ns = now_ns + round(OPERATOR_WAIT_S * 1e9)

    @property
    def operator_waits(self) -> bool:
        """Whether the scripted operator will take the shaft, but has not yet."""
        return self._operator_ns is not None

    @property
    def flexible(self) -> bool:
        """Whether a load lies behind a transmission: its motion is computed in substeps."""
        return self.mechanics.behind > 0.0

    def advance(self, now_ns: int) -> None:
        """Advance to ``now_ns`` [ns].

        Raises:
            ValueError: ``now_ns`` lies before the present time.
        """
        if now_ns < self.time_ns:
            raise ValueError(
                f"time went back from {self.time_ns} to {now_ns} ns; advance in order of time"
            )
        if self.arm is not None:
            self.arm(now_ns)
        pending = self._pending
        while pending and pending[0][0] <= now_ns:
            acts_ns, torque = pending.popleft()
            if acts_ns > self.time_ns:
                self._pass(acts_ns)
            self._act(torque)
        if now_ns > self.time_ns:
            self._pass(now_ns)
        if self._hand is not None:
            self._grasp = self._hand.look(now_ns)

    def command(self, torque: float, now_ns: int) -> float:
        """Command a torque that arrives at ``now_ns`` [ns] and acts the servo's delay later.

        Args:
            torque: Wanted [N·m]. Limited to the servo's limit, then rounded to its step (toward
                zero where the nearest step would pass the limit).
            now_ns: Arrival of the command; time is advanced to it.

        Returns:
            The torque that will act, or that a current loop will lead to [N·m].

        Raises:
            ValueError: The torque is not a finite number, or ``now_ns`` lies in the past.
        """
        acting = self.limited(torque)
        self.take(acting, now_ns)
        return acting

    def take(self, acting: float | None, now_ns: int) -> None:
        """Do the same with a torque that ``limited`` has returned [N·m]; None: limp."""
        self.advance(now_ns)
        taken_ns = now_ns if self._loop is None else self._loop.taken_over_ns(now_ns)
        acts_ns = taken_ns + self._delay_ns
        if acts_ns == now_ns:
            self._act(acting)
        else:
            self._pending.append((acts_ns, acting))

    def release(self, now_ns: int) -> None:
        """Switch the motor off at ``now_ns`` [ns]: after the servo's delay no current flows.

        Raises:
            ValueError: ``now_ns`` lies in the past.
        """
        self.take(None, now_ns)

    def feed(self, stall_torque: float) -> None:
        """Change the supply, by what the motor makes of it at a standstill [N·m]."""
        if self._loop is not None:
            self._loop.feed(stall_torque)

    def limited(self, torque: float) -> float:
        """Return the torque that a command for ``torque`` gives, limited and in whole steps [N·m].

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

    def measured(self) -> tuple[float, int]:
        """Return the encoder's position [rad] and its counts; 0 if it does not count."""
        per_radian, errors = self._counts_per_radian, self._errors
        seen = errors.position(self._followed)
        if per_radian == 0.0:
            return seen, 0
        counts = round(seen * per_radian + errors.noise(self.time_ns - self._origin_ns))
        return counts / per_radian, counts

    def begin(self) -> int:
        """Let begin what is due at the present time; return when that changes at the latest [ns].

        An arm calls it before each step, then ``drives`` and ``place``.
        """
        now_ns, pending = self.time_ns, self._pending
        while pending and pending[0][0] <= now_ns:
            self._act(pending.popleft()[1])
        end_ns = pending[0][0] if pending else FOREVER_NS
        self.held, turn_ns = self._grip(now_ns)
        if self._loop is not None:
            end_ns = min(end_ns, self._loop.end_ns)
        return min(end_ns, turn_ns)

    def drives(self, until_ns: int) -> tuple[float, float]:
        """Return torque at rest [N·m] and braking [N·m·s/rad] of the motor until ``until_ns``."""
        loop, now_ns = self._loop, self.time_ns
        if loop is not None:
            begin_ns = loop.begin_ns
            passed = loop.hold(now_ns)[0] * (now_ns - begin_ns) if now_ns > begin_ns else 0.0
            mean, self._braking = loop.hold(until_ns)
            self._torque = (mean * (until_ns - begin_ns) - passed) / (until_ns - now_ns)
        return self._torque, self._braking

    def place(self, position: float, velocity: float, now_ns: int) -> None:
        """Set the state at the end of a step [rad, rad/s]; with ``begin`` and ``drives``."""
        self._x, self._v, self.time_ns = position, velocity, now_ns
        half = self.mechanics.half
        self._followed = min(max(self._followed, position - half), position + half)
        if self._loop is not None and now_ns >= self._loop.end_ns:
            self._loop.moved(velocity, now_ns)

    def _act(self, torque: float | None) -> None:
        """Let a commanded torque begin to act; None: the motor is limp."""
        if self._loop is not None:
            self._loop.take(torque, self.motor_velocity, self.time_ns)
            self._stepped = self._state()
            return
        self._torque = torque or 0.0

    def _pass(self, until_ns: int) -> None:
        """Move to ``until_ns`` [ns], with the torque that the current loop makes meanwhile."""
        loop = self._loop
        if loop is None:
            self._move(until_ns)
            return
        while self.time_ns < until_ns:
            if self.time_ns > loop.begin_ns:  # somebody looked within this step: take it as a whole
                self._x, self._v, self._followed, self._end, self._z = self._stepped
                self._z = self._z[:]
                self.time_ns = loop.begin_ns
            end_ns = until_ns if loop.steady else loop.end_ns
            if self._operator_ns is not None and self._operator_ns > self.time_ns:
                end_ns = min(end_ns, self._operator_ns)
            stop_ns = min(end_ns, until_ns)
            self._torque, self._braking = loop.hold(stop_ns)
            self._move(stop_ns)
            if stop_ns == end_ns:
                loop.moved(self.motor_velocity, stop_ns)
                self._stepped = self._state()

    def _state(self) -> tuple[float, float, float, float, list[float]]:
        return self._x, self._v, self._followed, self._end, self._z[:]

    def _move(self, until_ns: int) -> None:
        """Move under the acting torque, divided where the operator starts or changes its slope."""
        now_ns = self.time_ns
        while now_ns < until_ns:
            hand, turn_ns = self._grip(now_ns)
            cut_ns = min(until_ns, turn_ns)
            self._step(hand, cut_ns - now_ns)
            now_ns = cut_ns
        self.time_ns = until_ns

    def _grip(self, now_ns: int) -> tuple[Hand, int]:
        """Return the operator at ``now_ns``, and until when the reference keeps its slope [ns].

        A scripted operator that has waited until then takes the shaft.
        """
        begin_ns = FOREVER_NS if self._operator_ns is None else self._operator_ns
        if now_ns >= begin_ns:
            self._operator = operator_of(replace(self._true, position=self.position))
            self._start_ns, self._operator_ns, begin_ns = begin_ns, None, FOREVER_NS
        if self._grasp is not None:
            hand, turn_ns = held_by(self._grasp, now_ns)
        elif self._operator is None:
            hand, turn_ns = NOBODY, FOREVER_NS
        else:
            hand, turn_ns = self._operator.pull(now_ns - self._start_ns)
            turn_ns += self._start_ns
        return hand, min(turn_ns, begin_ns)

    def _step(self, hand: Hand, length_ns: int) -> None:
        """Move for a time under the acting torque."""
        p, torque, braking = self.mechanics, self._torque, self._braking
        duration = length_ns * 1e-9
        if p.behind > 0.0:
            self._end = swing(p, hand, self._z, self._end, torque, braking, duration)
            self._followed = self.motor_position if self._on_motor else self.position
            return
        key = hand.stiffness, hand.damping, braking, duration
        kept = self._kept.get(key)
        if kept is None:
            if len(self._kept) >= _MOST_KEPT:
                self._kept.clear()
            kept = self._kept[key] = kept_for(p, hand, braking, duration)
        self._x, self._v, self._followed = move(
            p, kept, hand, self._x, self._v, self._followed, torque, braking, duration
        )
