"""A servo for trials behind the servo interface: fast, in-process, and as bad as its truth.

It models its ``Truth``, an operator on the output, and the exact instant at which a torque begins
to act. With ``truth.real`` the program's own plant moves it, with every effect. It does *not* model
a bus (reading and writing take no time, nothing is lost), a current sensor, or temperature.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.plant.operator_model import ReferenceStretch
from haptic_wall.hw.servo import Bus, Check, Facts, Outcome, Reading
from haptic_wall.hw.truth import TrueServo
from tests.support.body import Body
from tests.support.operators import NOBODY, NOTHING, Operator
from tests.support.truth import Truth

_OK = Outcome.OK
_NEVER_NS = 1 << 62
_LOOP_NS = 250_000
"""Longest time over which the torque of a current loop is held at its mean [ns]"""
_SOFT = 1e-3
"""Spring of an operator that only pushes the plant, toward a reference far away [N·m/rad]"""


class TrialServo:
    """A simulated servo; see the module.

    Attributes:
        body: The moving body; not with ``truth.real``.
        outputs: True position of the output at each request [rad]; grows by one per request.
    """

    def __init__(
        self,
        truth: Truth,
        clock: Clock,
        operator: Operator = NOBODY,
        *,
        position: float = 0.0,
        velocity: float = 0.0,
        struck: float = 0.0,
        step_s: float | None = None,
    ) -> None:
        """Create a servo without torque.

        Args:
            truth: Its true parameters.
            clock: Its time.
            operator: Moves the output, from now on.
            position: Position of both masses [rad]; the encoder is in the middle of its backlash.
            velocity: Velocity of both masses [rad/s].
            struck: Velocity that the load behind a transmission has in addition [rad/s].
            step_s: Longest step of the computation [s]; None: the usual one.

        Raises:
            ValueError: The truth has the effects of a real servo, and the operator a mass.
        """
        self.truth = truth
        self.facts = Facts(
            name="trial servo",
            counts_per_rev=truth.counts_per_rev,
            torque_limit=truth.torque_limit,
            torque_step=truth.torque_step,
            stall_torque=truth.stall_torque / truth.torque_gain,
            no_load_speed=truth.no_load_speed,
        )
        self.bus: Bus | None = None
        self.outputs: list[float] = []
        self._now_ns = clock.now_ns
        self._time_ns = self._start_ns = clock.now_ns()
        self._delay_ns = round(truth.delay * 1e9)
        self._pending: deque[tuple[int, float]] = deque()
        self._loop_rate = math.tau * truth.current_bandwidth
        self._goal = self._made = 0.0
        self._reading: Reading | None = None

        self._plant: Mechanism | None = None
        if truth.real is not None:
            if operator.mass:
                raise ValueError(f"the operator's mass is {operator.mass}; the plant takes none")
            self._plant = Mechanism(
                true_servo(truth, position),
                self._time_ns,
                velocity=velocity,
                operator=_Rows(operator) if operator.rows else None,
            )
            return
        self.body = body = Body(truth, position, velocity, step_s)
        body.velocity += struck
        self._per_radian = truth.counts_per_rev / math.tau
        self._rows = operator.rows
        self._row_ns = operator.row_ns
        self._next_ns = self._start_ns
        self._at = 0
        body.mass = operator.mass if operator.rows else 0.0

    def start(self) -> list[Check]:
        """Return no checks; its time runs since its creation."""
        return []

    def request(self) -> None:
        """Sample the position now."""
        now_ns = self._now_ns()
        plant = self._plant
        if plant is not None:
            plant.advance(now_ns)
            self.outputs.append(plant.position)
            self._reading = Reading(_OK, *plant.measured(), now_ns, math.nan, False)
            return
        self._advance(now_ns)
        body, per_radian = self.body, self._per_radian
        self.outputs.append(body.position)
        position = body.followed
        counts = 0
        if per_radian:
            counts = round(position * per_radian)
            position = counts / per_radian
        self._reading = Reading(_OK, position, counts, now_ns, math.nan, False)

    def collect(self, deadline_ns: int) -> Reading:  # noqa: ARG002 - nothing to wait for
        """Return the sample of the last ``request``, at once."""
        assert self._reading is not None, "call request first"
        return self._reading

    def write(self, torque: float) -> float:
        """Command a torque that acts ``truth.delay`` later; return it limited and rounded [N·m]."""
        truth = self.truth
        if self._plant is not None:
            gain = truth.torque_gain
            return self._plant.command(gain * torque, self._now_ns()) / gain
        limit, step = truth.torque_limit, truth.torque_step
        if not -limit <= torque <= limit:
            if not math.isfinite(torque):
                raise ValueError(f"torque is {torque}; command a finite number of N·m")
            torque = limit if torque > 0.0 else -limit
        if step:
            steps = round(torque / step)
            torque = steps * step
            if abs(torque) > limit:
                torque = (steps - (1 if steps > 0 else -1)) * step
        self._pending.append((self._now_ns() + self._delay_ns, truth.torque_gain * torque))
        return torque

    def stop(self) -> bool:
        """Switch torque off at once. Always succeeds."""
        if self._plant is not None:
            self._plant.command(0.0, self._now_ns())
            return True
        self._advance(self._now_ns())
        self._pending.clear()
        self.body.torque = self._goal = self._made = 0.0
        return True

    def close(self) -> None:
        """Do nothing: it holds no resource."""

    def _advance(self, now_ns: int) -> None:
        """Move until ``now_ns`` [ns], divided where a torque or the operator changes."""
        time_ns, pending, body = self._time_ns, self._pending, self.body
        lags = self._loop_rate > 0.0
        while time_ns < now_ns:
            while pending and pending[0][0] <= time_ns:
                body.torque = self._goal = pending.popleft()[1]
            if time_ns >= self._next_ns:
                self._next_row()
            cut_ns = now_ns if now_ns <= self._next_ns else self._next_ns
            if pending and pending[0][0] < cut_ns:
                cut_ns = pending[0][0]
            if lags:
                cut_ns = min(cut_ns, time_ns + _LOOP_NS)
                body.torque = self._loop(cut_ns - time_ns)
            body.move(cut_ns - time_ns)
            time_ns = cut_ns
        self._time_ns = time_ns

    def _loop(self, length_ns: int) -> float:
        """Return the mean torque of the current loop over a time that begins now [N·m]."""
        turn = self._loop_rate * length_ns * 1e-9
        away, left = self._made - self._goal, math.exp(-turn)
        self._made = self._goal + away * left
        return self._goal + away * (1.0 - left) / turn

    def _next_row(self) -> None:
        """Set the operator's motion from now on."""
        at = self._at
        if at < len(self._rows):
            self.body.take(self._rows[at])
            self._at = at + 1
            self._next_ns += self._row_ns
        else:  # released for good, and its mass with it
            self.body.take(NOTHING)
            self.body.mass = 0.0
            self._next_ns = _NEVER_NS


def true_servo(truth: Truth, position: float) -> TrueServo:
    """Return the plant's description of a servo at a position [rad].

    The lag of the current loop is a part of ``truth.delay``.
    """
    real: dict[str, Any] = truth.real or {}
    lag = 1.0 / (math.tau * real["current_bandwidth"])
    return TrueServo(
        inertia=truth.inertia,
        damping=truth.damping,
        coulomb=truth.coulomb,
        counts_per_rev=truth.counts_per_rev,
        delay=max(truth.delay - lag, 0.0),
        torque_limit=truth.torque_gain * truth.torque_limit,
        torque_step=truth.torque_gain * truth.torque_step,
        backlash=truth.backlash,
        back_emf=truth.back_emf == "current",
        no_load_speed=truth.no_load_speed,
        position=position,
        **real,
    )


class _Rows:
    """The operator of a trial, as the plant asks for it."""

    def __init__(self, operator: Operator) -> None:
        self._rows, self._row_ns = operator.rows, operator.row_ns

    def pull(self, elapsed_ns: int) -> ReferenceStretch:
        """Return the stretch of the reference at ``elapsed_ns`` [ns since the start]."""
        at = elapsed_ns // self._row_ns
        if at >= len(self._rows):
            return ReferenceStretch(0.0, 0.0, _NEVER_NS, 0.0, 0.0)
        spring, damper, wanted, speed, push = self._rows[at]
        if push:
            spring = spring or _SOFT
            wanted += push / spring
        wanted += speed * (elapsed_ns - at * self._row_ns) * 1e-9
        return ReferenceStretch(wanted, speed, (at + 1) * self._row_ns, spring, damper)
