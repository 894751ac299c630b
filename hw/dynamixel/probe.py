"""Proves the torque's sign at the start: pushes the shaft by a few encoder counts.

With a reversed position and an unreversed current the wall would drive the servo *into* the wall.
The sign is therefore measured, not taken from the manual.

The push is a slow torque ramp, which ends at a given limit: a free servo barely moves, and one with
friction breaks loose gently. The opposite torque follows until the impulses cancel. This braking
stops a servo without friction; one with friction stops by itself. A servo with more static than
kinetic friction could be driven back toward the wall, so a reversal also ends the braking.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptic_wall.hw.dynamixel.driven import Driven, rearm
from haptic_wall.hw.dynamixel.register_access import UNHELD, Table
from haptic_wall.hw.dynamixel.registers import WATCHDOG_TRIPPED
from haptic_wall.hw.dynamixel.rules import Verdict
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw
from haptic_wall.hw.dynamixel.wire import CYCLE_BYTES
from haptic_wall.hw.errors import ServoLostError, UnfitServoError
from haptic_wall.hw.servo import Check, Outcome

_PUSHES: Final = 3
"""Largest number of attempts: without real-time settings a stall may exceed the Bus Watchdog"""
_PERIOD_NS: Final = 1_000_000
_CYCLE_SHARE: Final = 0.8
"""Largest fraction of a period for a cycle on the wire"""
_PATIENCE_NS: Final = 10_000_000
"""Time allowed for one reply, without its time on the wire; a third of the shortest Bus Watchdog in
use"""
_LOSSES: Final = 10
"""Consecutive lost replies that end the probe"""
_REST_NS: Final = 50_000_000
"""Time without motion that counts as rest"""
_REST_END_NS: Final = 5_000_000_000
_REST_COUNTS: Final = 1
"""Flicker of an encoder at rest, between two counts"""
_RAMP_NS: Final = 400_000_000
"""Time from zero to the largest torque"""
_HOLD_NS: Final = 100_000_000
"""Time at the largest torque before giving up"""
_MOVED_COUNTS: Final = 3
"""More than the backlash between shaft and encoder and than an encoder's flicker"""
_TURNED_COUNTS: Final = 2
"""Distance back from the furthest position that counts as a reversal: more than an encoder's
flicker"""


@dataclass(frozen=True, slots=True)
class Push:
    """The result of one push."""

    moved: int
    """[encoder counts]; 0: it did not move"""
    peak: int
    """Largest goal current, with its sign [current units]"""

    @property
    def sign_is_right(self) -> bool:
        """Whether the motion has the sign of the torque."""
        return self.moved * self.peak > 0


def prove_the_sign(servo: Driven, law: TorqueLaw, current_limit: int, name: str) -> Check:
    """Check that a small torque away from the wall moves the shaft away from the wall.

    A hand may be on the shaft: the push waits until the shaft rests, and one with the wrong result
    is repeated. So is one in which the line was silent, or the Bus Watchdog tripped.

    Args:
        servo: The servo, with torque on at zero torque, which stays.
        law: Converts torque to goal current.
        current_limit: Current limit of the servo.
        name: Name of the servo, for messages.

    Raises:
        UnfitServoError: The shaft does not rest.
        ServoLostError: The servo stops replying.
    """
    settings, table = servo.settings, servo.table
    most = settings.probe_torque
    if most <= 0.0:
        return Check("torque sign", True, "not probed", "not asked for")
    if settings.torque_limit > 0.0:
        most = min(most, settings.torque_limit)
    limit = max(1, min(law.within(most), current_limit))
    prober = _Prober(table, name)
    for _ in range(_PUSHES):
        push = prober.attempt(limit if settings.sign * settings.probe_direction > 0 else -limit)
        tripped = not push.moved and table.read("bus_watchdog") == WATCHDOG_TRIPPED
        armed = not tripped or rearm(table, servo.units)
        if push.sign_is_right or not armed:
            break
    torque = law.torque(push.peak)
    found = f"no motion at {torque:+.3f} N·m"
    why = f"Its shaft did not move at {abs(torque):.2g} N·m"
    advice = (
        "free it if it is blocked or held, hold it up if a weight or an arm is on it, raise PWM "
        "Limit (36) if it is low, or raise servo.probe_torque; 0 skips the probe, once the sign is "
        "known"
    )
    if push.moved:
        found = f"{push.moved:+d} counts at {torque:+.3f} N·m"
        why = f"Its shaft moved the wrong way ({found}), so a wall would pull instead of push"
        advice = "keep the shaft free during the start, then check Drive Mode (10)"
    elif tripped:
        found = "no motion, because the Bus Watchdog tripped"
        why = f"Its Bus Watchdog ({settings.watchdog_s * 1e3:.0f} ms) ended the probe of the sign"
        advice = "find the cause of this machine's stalls, or raise servo.watchdog_s"
        if late := table.lateness():
            why, advice = why + late, UNHELD
    if push.sign_is_right:
        why = advice = ""
    return Verdict(found, "motion with the torque", why, advice).check("torque sign")


class _Prober:
    """Pushes a servo, at 1 kHz or as fast as the bus can, which keeps its Bus Watchdog quiet."""

    def __init__(self, table: Table, name: str) -> None:
        self._table = table
        self._exchange = exchange = table.exchange
        self._clock = table.clock
        self._name = name
        self._losses = 0
        self._silent = False
        self._position = 0
        cycle_ns = exchange.wire_ns(CYCLE_BYTES)
        self._period_ns = max(_PERIOD_NS, round(cycle_ns / _CYCLE_SHARE))
        self._patience_ns = _PATIENCE_NS + cycle_ns

    def attempt(self, limit: int) -> Push:
        """Push until the shaft moves; no motion where the line was silent for once.

        Args:
            limit: Largest goal current, with the sign of the push [current units].
        """
        try:
            self._wait_for_rest()
            return self._push(limit)
        except ServoLostError as error:
            if self._silent or not self._ended():
                raise self._table.lost(error.problem.what) from None
            self._silent = True
            return Push(0, 0)

    def _wait_for_rest(self) -> None:
        begun = since = self._cycle(0)
        low = high = self._position
        while (now := self._cycle(0)) - since < _REST_NS:
            low, high = min(low, self._position), max(high, self._position)
            if now - begun > _REST_END_NS:
                raise UnfitServoError(
                    f"The shaft of the {self._name} has not come to rest within "
                    f"{_REST_END_NS * 1e-9:.0f} s, so the torque's sign cannot be proved",
                    advice="hold it still, or set servo.probe_torque=0 to skip the probe.",
                )
            if high - low > _REST_COUNTS:
                since, low, high = now, self._position, self._position

    def _push(self, limit: int) -> Push:
        """Ramp up to ``limit`` until the shaft moves, then stop it."""
        origin = self._position
        begun = before = self._clock.now_ns()
        impulse = goal = 0
        while abs(self._position - origin) < _MOVED_COUNTS:
            now = self._cycle(goal)
            impulse += goal * (now - before)
            before = now
            elapsed = now - begun
            if elapsed > _RAMP_NS + _HOLD_NS:
                self._end()
                return Push(0, goal)
            goal = round(limit * min(1.0, elapsed / _RAMP_NS))
        moved, peak = self._position - origin, goal
        self._brake(impulse, peak, 1 if moved > 0 else -1)
        return Push(moved, peak)

    def _brake(self, impulse: int, peak: int, way: int) -> None:
        """Cancel the impulse with half the torque, unless the shaft reverses."""
        half = (abs(peak) + 1) // 2
        goal = -half if peak > 0 else half
        before = self._clock.now_ns()
        furthest = way * self._position
        while impulse * peak > 0 and furthest - way * self._position < _TURNED_COUNTS:
            now = self._cycle(goal)
            impulse += goal * (now - before)
            before = now
            furthest = max(furthest, way * self._position)
        self._end()

    def _ended(self) -> bool:
        """Set zero torque, as a goal in the usual frame is not confirmed; return whether it is."""
        self._losses = 0
        if self._table.try_write("goal_current", 0) == 0:
            return True
        # A tripped one accepts no goal, and has no torque.
        return self._table.try_read("bus_watchdog") == WATCHDOG_TRIPPED

    def _end(self) -> None:
        if not self._ended():
            raise ServoLostError(
                f"The {self._name} has not confirmed its goal of zero torque after the "
                "probe of the torque's sign"
            )

    def _cycle(self, goal: int) -> int:
        """Execute one period at a goal current; return its end [ns]."""
        exchange, clock = self._exchange, self._clock
        begun = clock.now_ns()
        exchange.send((goal,))
        exchange.request()
        (sample,) = exchange.collect(begun + self._patience_ns)
        if sample.outcome is Outcome.OK:
            self._position = sample.counts
            self._losses = 0
        else:
            self._losses += 1
            if self._losses >= _LOSSES:
                raise ServoLostError(
                    f"The {self._name} stopped answering while the torque's sign was probed"
                )
        clock.wait_until(begun + self._period_ns)
        return clock.now_ns()
