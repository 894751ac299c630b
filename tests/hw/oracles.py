"""Independent answers that the simulated servo is held against; nothing here uses ``haptic_wall``
but the names of a servo's parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from haptic_wall.hw.truth import TrueServo


class Stretch(NamedTuple):
    """A time over which the torque is held and the hand's reference moves linearly."""

    duration: float
    torque: float
    reference: float = 0.0
    slope: float = 0.0


def _left(speed: float, stribeck: float) -> float:
    """Share of the excess at rest that is left at a speed."""
    return math.exp(-abs(speed) / stribeck) if stribeck > 0.0 else 0.0


class Body(NamedTuple):
    """A servo with friction that depends on speed, direction and load, a weight and cogging.

    With ``true.load_inertia`` it is the motor; a transmission is between it and the load.
    """

    true: TrueServo
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0

    def viscous(self, sign: float) -> float:
        """Damping in this direction [N·m·s/rad]."""
        back = self.true.damping_back
        return self.true.damping if sign > 0.0 or back is None else back

    def friction(self, load: float, left: float) -> float:
        """Friction with so much left of that at rest, under this load [N·m]."""
        true = self.true
        excess = (true.static_friction or true.coulomb) - true.coulomb
        return true.coulomb + left * excess + true.load_friction * abs(load)

    def cogs(self, x: float) -> float:
        """Torque of the cogging [N·m]."""
        true = self.true
        return -true.cogging * math.sin(true.cogging_periods * x + true.cogging_phase)

    def outside(self, stretch: Stretch, time: float, x: float, v: float) -> float:
        """Torque of the hand and the weight on the output [N·m]."""
        reference = stretch.reference + stretch.slope * time
        hand = self.hand_stiffness * (reference - x) + self.hand_damping * (stretch.slope - v)
        return hand - self.true.gravity * math.sin(x - self.true.gravity_angle)

    def torques(
        self, stretch: Stretch, time: float, x: float, v: float, left: float
    ) -> tuple[float, float]:
        """Return the torque that pushes a rigid servo, and its friction [N·m].

        Args:
            stretch: Of the motion.
            time: [s]
            x: Position [rad].
            v: Velocity [rad/s].
            left: Fraction of the friction at rest that is left [1].
        """
        outside = self.outside(stretch, time, x, v)
        push = stretch.torque + outside + self.cogs(x)
        return push, self.friction(outside - stretch.torque, left)

    def contact(self, x: float, v: float, y: float, w: float) -> int:
        """Return the side on which the transmission pushes; 0: none."""
        true, side = self.true, 1 if x > y else -1
        deep = side * (x - y) - 0.5 * true.backlash
        pushes = true.transmission_stiffness * deep + true.transmission_damping * side * (v - w) > 0
        return side if true.backlash == 0.0 or (deep > 0.0 and pushes) else 0

    def passed(self, side: int, x: float, v: float, y: float, w: float) -> float:
        """Return the transmitted torque [N·m]."""
        if side == 0:
            return 0.0
        twist = x - y - (0.5 * side * self.true.backlash)
        return self.true.transmission_stiffness * twist + self.true.transmission_damping * (v - w)

    def net(
        self, stretch: Stretch, side: int, state: Sequence[float], left: float
    ) -> tuple[float, float]:
        """Return what pushes the motor, and its friction with so much left of that at rest."""
        x, v, y, w = state
        passed = self.passed(side, x, v, y, w)
        push = stretch.torque + self.cogs(x) - passed
        return push, self.friction(passed + stretch.torque, left)


def integrate(
    body: Body, state: Sequence[float], stretches: Sequence[Stretch]
) -> list[Sequence[float]]:
    """Position and velocity after every stretch, by Runge-Kutta 8(5,3) with events.

    Of two masses those of the motor come first.
    """
    states = []
    for stretch in stretches:
        state = (_coupled if body.true.load_inertia else _rigid)(body, state, stretch)
        states.append(state)
    return states


def _rigid(body: Body, state: Sequence[float], stretch: Stretch) -> Sequence[float]:
    (position, velocity), time = state, 0.0
    while time < stretch.duration:
        if velocity == 0.0:
            push, friction = body.torques(stretch, time, position, 0.0, 1.0)
            sign = math.copysign(1.0, push)
            if abs(push) <= friction:
                if body.hand_stiffness * stretch.slope == 0.0:
                    return position, 0.0
                sign = math.copysign(1.0, stretch.slope)

                def excess(t: float, here: float = position, sign: float = sign) -> float:
                    push, friction = body.torques(stretch, t, here, 0.0, 1.0)
                    return sign * push - friction

                times = np.linspace(time, stretch.duration, 200).tolist()
                leaves = next((k for k, t in enumerate(times) if excess(t) > 0.0), 0)
                if leaves == 0:
                    return position, 0.0
                time = float(
                    brentq(excess, times[leaves - 1], times[leaves], xtol=1e-18, rtol=8.9e-16)
                )
        else:
            sign = math.copysign(1.0, velocity)

        def slope(t: float, state: NDArray[np.float64], sign: float = sign) -> list[float]:
            x, v = state.tolist()
            push, friction = body.torques(stretch, t, x, v, _left(v, body.true.stribeck_speed))
            push -= body.viscous(sign) * v + sign * friction
            return [v, push / body.true.inertia]

        begun = time if velocity == 0.0 else -1.0

        def rest(
            t: float, state: NDArray[np.float64], sign: float = sign, begun: float = begun
        ) -> float:
            # The start of a body at rest does not count, or its first short slide would be lost.
            return 1.0 if t == begun else sign * float(state[1])

        # Rounding at the instant of breaking away must not count as coming to rest.
        begins = abs(slope(time, np.array([position, 0.0]))[1]) > 1e-9
        rest.terminal = velocity != 0.0 or begins  # type: ignore[attr-defined]
        rest.direction = -1.0  # type: ignore[attr-defined]
        solution = solve_ivp(
            slope,
            (time, stretch.duration),
            [position, velocity],
            method="DOP853",
            rtol=1e-12,
            atol=1e-14,
            events=rest,
        )
        assert solution.success, solution.message
        time = float(solution.t[-1])
        position = float(solution.y[0, -1])
        velocity = 0.0 if solution.status == 1 else float(solution.y[1, -1])
    return position, velocity


def _coupled(body: Body, state: Sequence[float], stretch: Stretch) -> Sequence[float]:
    time, breaks = 0.0, 0.0
    for _ in range(1000):
        v = state[1]
        side = body.contact(*state)
        push, friction = body.net(stretch, side, state, 1.0)
        sign = math.copysign(1.0, v) if v != 0.0 else breaks
        if v == 0.0 and not breaks and abs(push) > friction:
            sign = math.copysign(1.0, push)

        def slope(
            t: float, now: Sequence[float], sign: float = sign, side: int = side
        ) -> list[float]:
            v = now[1]
            push, friction = body.net(stretch, side, now, _left(v, body.true.stribeck_speed))
            push -= body.viscous(sign) * v + sign * friction
            pull = body.passed(side, *now) + body.outside(stretch, t, *now[2:])
            rates = [v if sign else 0.0, push / body.true.inertia if sign else 0.0]
            return [*rates, now[3], pull / body.true.load_inertia]

        def motor(
            t: float,
            now: NDArray[np.float64],
            sign: float = sign,
            side: int = side,
            begun: float = time if v == 0.0 else -1.0,
        ) -> float:
            if sign:
                return 1.0 if t == begun else sign * float(now[1])
            push, friction = body.net(stretch, side, list(map(float, now)), 1.0)
            return friction - abs(push)

        def touch(
            t: float, now: NDArray[np.float64], side: int = side, begun: float = time
        ) -> float:
            x, v, y, w = map(float, now)
            if body.true.backlash == 0.0 or t == begun:
                return 1.0
            if side:
                return side * body.passed(side, x, v, y, w)
            return 0.5 * body.true.backlash - (x - y) * math.copysign(1.0, v - w)

        motor.terminal = touch.terminal = True  # type: ignore[attr-defined]
        motor.direction = touch.direction = -1.0  # type: ignore[attr-defined]
        found = solve_ivp(
            slope,
            (time, stretch.duration),
            state,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            events=(motor, touch),
        )
        assert found.success, found.message
        time, last = float(found.t[-1]), found.y[:, -1]
        stopped, touched = (len(times) > 0 for times in found.t_events)
        breaks = 0.0
        if sign == 0.0 and stopped:
            push, _ = body.net(stretch, side, last.tolist(), 1.0)
            breaks = math.copysign(1.0, push)
        if touched:  # a little beyond the contact's begin or end
            last = last + 1e-10 * np.array(slope(time, last.tolist()))
            time += 1e-10
        state = ended = last.tolist()
        if sign == 0.0 or stopped:
            ended[1] = 0.0
        if time >= stretch.duration:
            return state
    raise AssertionError("the motion has too many events")
