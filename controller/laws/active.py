"""Renders a user's law that depends on time, called in every tick; a tank limits its energy.

Such a law may give energy without end. Here it gives what it took before: each tick the energy that
its torque took from the shaft fills a tank, the energy that it gave empties it, and no torque is
sent that could give more than the tank holds. Damping is not limited, and fills nothing.

The torque that acts between two samples is not known exactly: any torque still in flight may, so
the worst of them counts. Neither is the way that the shaft will take: the tank must cover the
longest one, from its last speed, with an acceleration of ``MOST_ACCELERATION``.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass

from haptic_wall.controller.laws.own import Instants, OwnLaw
from haptic_wall.controller.laws.shaped import ShapedLaw
from haptic_wall.controller.laws.wall import limited_torque

LENT_J = 1e-3
"""The tank's first content [J]. Without it no torque could be sent, and nothing absorbed"""
MOST_ACCELERATION = 1000.0
"""Acceleration of the shaft that the tank covers [rad/s²]; beyond it the tank may be overdrawn"""
SLOW_CALLS = 3
"""Consecutive calls longer than half a period that end a run"""
TURN_COUNTS = 2.0
"""Counts to either side of a place that are no motion"""
LEAST_MOVE = 1e-6
"""Motion over which a slope is taken [rad]: below it rounding looks steep"""


@dataclass(frozen=True, slots=True)
class Port:
    """The facts of loop and servo that the tank needs."""

    now_ns: Callable[[], int]
    """Clock of the loop [ns]"""
    period: float
    """Sampling period [s]"""
    step: float
    """Encoder step [rad]"""
    torque_limit: float
    """[N·m]"""
    torque_step: float
    """Step of the commanded torque [N·m]"""
    in_flight: int
    """Periods in which a torque may act, from the one in which it is sent"""
    capacity: float
    """Of the tank [J]"""


class Tank:
    """The energy that a law may still give.

    Args:
        port: The facts of loop and servo.

    Attributes:
        held: Content [J].
        absorbed: Energy that the law took, at the least [J].
        given: Energy that it gave, at the most [J].
        limited: Ticks in which the tank limited the torque.
    """

    __slots__ = (
        "_at",
        "_flight",
        "_moved",
        "_periods",
        "_port",
        "_way",
        "absorbed",
        "given",
        "held",
        "limited",
    )

    def __init__(self, port: Port) -> None:
        self._port = port
        self.held = LENT_J
        self.absorbed = self.given = 0.0
        self.limited = 0
        self._flight: deque[float] = deque([0.0] * port.in_flight, maxlen=port.in_flight)
        self._moved, self._periods, self._way, self._at = 0.0, 1.0, 0.0, 0.0

    def move(self, moved: float, periods: float) -> None:
        """Count the energy of the motion since the last sample.

        Args:
            moved: The motion [rad].
            periods: Its time, in periods.
        """
        self._moved, self._periods = moved, periods
        # The direction turns after some counts: noise of the encoder does not turn it.
        room = TURN_COUNTS * self._port.step
        self._at += moved
        if abs(self._at) > room:
            self._way = self._at
            self._at = math.copysign(room, self._at)
        flight = self._flight
        worst = moved * (max(flight) if moved > 0.0 else min(flight))
        if periods > 1.5 and worst < 0.0:
            worst = 0.0  # without a sample no torque was sent: it may not have absorbed
        self._take(worst)

    def rest(self) -> None:
        """Torque off: the torques in flight may give what was reserved for them."""
        self._take(self._reserved())
        self._flight.extend([0.0] * self._port.in_flight)

    def allowed(self, torque: float) -> float:
        """Return the torque that may be sent [N·m], and count it as sent."""
        flight = self._flight
        flight.append(0.0)
        reach = self._reach(torque)
        if torque and reach:
            # What it was lent stays for torques against the motion, which absorb.
            kept = LENT_J if torque * self._way > 0.0 else 0.0
            spare = min(self.held - self._reserved(), (self.held - kept) / len(flight))
            most = max(0.0, spare / reach)
            if abs(torque) > most:
                torque = math.copysign(most, torque)
                self.limited += 1
        if grid := self._port.torque_step:
            # On the grid of the servo's torques its rounding takes nothing from what is counted.
            torque = math.trunc(torque / grid) * grid
        flight[-1] = torque
        return torque

    def _reserved(self) -> float:
        """Return the energy that the torques in flight may still give [J]."""
        return math.fsum(abs(torque) * self._reach(torque) for torque in self._flight if torque)

    def _reach(self, torque: float) -> float:
        """Return the longest way with this torque while it may act [rad]."""
        port, periods = self._port, self._periods
        speed = math.copysign(1.0, torque) * (self._moved / periods) + port.step
        gain = MOST_ACCELERATION * port.period * port.period
        ways = (speed + (i + periods) * gain for i in range(port.in_flight))
        return math.fsum(way for way in ways if way > 0.0)

    def _take(self, energy: float) -> None:
        if energy > 0.0:
            self.given += energy
        else:
            self.absorbed -= energy
        self.held = min(self._port.capacity, self.held - energy)


class ActiveLaw(ShapedLaw):
    """A user's law, called in every tick with position and time; attributes as of ``Law``.

    Args:
        name: Name of the law, for people.
        own: The user's law.
        shape: Its tables, measured before the run.
        position: Position from which its positions count [rad].
        clip: Largest torque of spring and damper together [N·m].
        port: The facts of loop and servo.

    Attributes:
        tank: Its energy tank.
    """

    __slots__ = (
        "_away",
        "_began_ns",
        "_limit",
        "_low_high",
        "_own",
        "_port",
        "_sampled_ns",
        "_slow",
        "_steepest",
        "fault",
        "tank",
    )

    def __init__(
        self, name: str, own: OwnLaw, shape: Instants, position: float, clip: float, port: Port
    ) -> None:
        super().__init__(name, shape, position, clip)
        self._own, self._port = own, port
        self._low_high = float(own.low), float(own.high)
        self._limit = min(clip, port.torque_limit)
        self._steepest = shape.stiffness
        self._began_ns: int | None = None
        self._away = math.nan
        self._sampled_ns = self._slow = 0
        self.fault = ""
        self.tank = Tank(port)

    def settle(self, position: float) -> None:
        """Start without torque, wherever the shaft is; the tank keeps its content."""
        super().settle(position)
        self.tank.rest()
        self._away = math.nan

    def torque(self, position: float, velocity: float) -> float:
        """Return the torque [N·m]; NaN after the law failed, which ``fault`` describes."""
        away, port, tank = position - self.position, self._port, self.tank
        if math.isnan(away):
            return away  # not a number: the safety checks must see it
        now_ns = port.now_ns()
        if self._began_ns is None:
            self._began_ns = now_ns
        before, self._away = self._away, away
        periods = max(1.0, (now_ns - self._sampled_ns) * 1e-9 / port.period)
        self._sampled_ns = now_ns
        torque = self._asked(away, before, (now_ns - self._began_ns) * 1e-9)
        if math.isnan(torque):
            return torque
        if math.isnan(before):
            torque = 0.0  # the speed is not known yet
        else:
            tank.move(away - before, periods)
        derating, stiffness = self.derating, self.stiffness
        softer = stiffness * derating.scale
        torque *= softer / self._steepest
        limit = derating.elastic_limit
        if torque > limit or torque < -limit:
            torque = limited_torque(torque, limit, softer * (abs(away) - derating.soft_to))
        most = self._limit
        torque = tank.allowed(max(-most, min(torque, most)))
        torque -= (self.damping + self.injected) * derating.damping_scale * velocity
        return max(-self.clip, min(torque, self.clip))

    def _asked(self, away: float, before: float, time: float) -> float:
        """Return the torque of the user's law [N·m]; NaN: it failed.

        A slope between two samples that is steeper than any before makes the law flatter from this
        tick on, so that K stays its steepest slope.
        """
        low, high = self._low_high
        here, there = (min(max(place, low), high) for place in (away, before))
        began_ns = self._port.now_ns()
        try:
            with redirect_stdout(sys.stderr):
                torque = float(self._own.torque(here, time))
                moved = abs(here - there)
                if moved > LEAST_MOVE:
                    slope = abs(torque - float(self._own.torque(there, time))) / moved
                    if not slope <= self._steepest:
                        self._steepest = slope
        except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever a user's code raises
            self.fault = f"{self.name} failed at {here:.4g} rad ({type(error).__name__}: {error})"
            return math.nan
        if not (math.isfinite(torque) and math.isfinite(self._steepest)):
            self.fault = f"{self.name} gave no finite torque near {here:.4g} rad ({torque})"
            return math.nan
        took = (self._port.now_ns() - began_ns) * 1e-9
        self._slow = self._slow + 1 if took > 0.5 * self._port.period else 0
        if self._slow >= SLOW_CALLS:
            self.fault = f"{self.name} took {took * 1e3:.3g} ms for a torque, {SLOW_CALLS} times"
            return math.nan
        return torque
