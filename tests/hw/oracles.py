"""Independent answers that the simulated servo is held against; nothing here uses
``haptic_wall``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq


class Stretch(NamedTuple):
    """A time over which the torque is held and the hand's reference moves linearly."""

    duration: float
    torque: float
    reference: float = 0.0
    slope: float = 0.0


def _left(speed: float, stribeck: float) -> float:
    """Share of the excess at rest that is left at a speed."""
    return math.exp(-abs(speed) / stribeck) if stribeck > 0.0 else 0.0


class Uneven(NamedTuple):
    """A servo with friction that depends on speed, direction and load, a weight and cogging."""

    inertia: float
    forth: float
    back: float
    coulomb: float
    static: float
    stribeck: float
    load: float
    gravity: float
    angle: float
    cogging: float
    periods: float
    phase: float
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0
    braking: float = 0.0

    def torques(
        self, stretch: Stretch, time: float, x: float, v: float, left: float
    ) -> tuple[float, float]:
        """What pushes the shaft, and its friction with so much left of that at rest [N·m]."""
        motor = stretch.torque - self.braking * v
        reference = stretch.reference + stretch.slope * time
        outside = (
            self.hand_stiffness * (reference - x)
            + self.hand_damping * (stretch.slope - v)
            - self.gravity * math.sin(x - self.angle)
        )
        cogs = -self.cogging * math.sin(self.periods * x + self.phase)
        friction = self.coulomb + left * (self.static - self.coulomb)
        friction += self.load * abs(outside - motor)
        return motor + outside + cogs, friction


def integrate_uneven(
    body: Uneven,
    position: float,
    velocity: float,
    stretches: Sequence[Stretch],
    tolerance: float = 1e-12,
) -> list[tuple[float, float]]:
    """Position and velocity at the end of every stretch, by Runge-Kutta 8(5,3) with events."""
    states = []
    for stretch in stretches:
        position, velocity = _integrate_uneven(body, position, velocity, stretch, tolerance)
        states.append((position, velocity))
    return states


def _integrate_uneven(
    body: Uneven, position: float, velocity: float, stretch: Stretch, tolerance: float
) -> tuple[float, float]:
    time = 0.0
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
            push, friction = body.torques(stretch, t, x, v, _left(v, body.stribeck))
            push -= (body.forth if sign > 0.0 else body.back) * v
            push -= sign * friction
            return [v, push / body.inertia]

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
            rtol=tolerance,
            atol=1e-14,
            events=rest,
        )
        assert solution.success, solution.message
        time = float(solution.t[-1])
        position = float(solution.y[0, -1])
        velocity = 0.0 if solution.status == 1 else float(solution.y[1, -1])
    return position, velocity


def closed_loop_poles(
    *,
    inertia: float,
    damping: float,
    stiffness: float,
    virtual_damping: float,
    period: float,
    delay: float,
) -> np.ndarray:
    """Poles of a two-sided wall on the backward difference, from the state matrix.

    The state is position, velocity, the position one sample ago, and the torques sent 1, 2 ..
    samples ago: a delay of n + f periods lets the torque of n + 1 samples ago act for the first
    f of a period and that of n samples ago for the rest.
    """
    whole, fraction = divmod(delay / period, 1.0)
    n = int(whole)
    generator = np.array(
        [[0.0, 1.0, 0.0], [0.0, -damping / inertia, 1.0 / inertia], [0.0, 0.0, 0.0]]
    )
    first = expm(generator * fraction * period)
    second = expm(generator * (1.0 - fraction) * period)
    old, new = 3 + n, 3 + n - 1
    size = 3 + n + 1
    sent = np.zeros(size)
    sent[0] = -(stiffness + virtual_damping / period)
    sent[2] = virtual_damping / period
    matrix = np.zeros((size, size))
    matrix[:2, :2] = second[:2, :2] @ first[:2, :2]
    matrix[:2, old] += second[:2, :2] @ first[:2, 2]
    if n == 0:
        matrix[:2, :] += np.outer(second[:2, 2], sent)
    else:
        matrix[:2, new] += second[:2, 2]
    matrix[2, 0] = 1.0
    matrix[3, :] = sent
    for k in range(4, size):
        matrix[k, k - 1] = 1.0
    return np.linalg.eigvals(matrix)


class Coupled(NamedTuple):
    """A motor and a load with a transmission between them, friction on the motor's side."""

    inertia: float
    forth: float
    back: float
    coulomb: float
    static: float
    stribeck: float
    load: float
    gravity: float
    angle: float
    cogging: float
    periods: float
    phase: float
    load_inertia: float
    stiffness: float
    damping: float
    gap: float
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0

    def contact(self, x: float, v: float, y: float, w: float, *_: float) -> int:
        """Return the side on which the transmission pushes; 0: none."""
        side = 1 if x > y else -1
        deep = side * (x - y) - 0.5 * self.gap
        pushes = self.stiffness * deep + self.damping * side * (v - w) > 0.0
        return side if self.gap == 0.0 or (deep > 0.0 and pushes) else 0

    def passed(self, side: int, x: float, v: float, y: float, w: float, *_: float) -> float:
        """Return the transmitted torque [N·m]."""
        if side == 0:
            return 0.0
        twist = x - y - (0.5 * side * self.gap)
        return self.stiffness * twist + self.damping * (v - w)

    def net(
        self, stretch: Stretch, side: int, state: Sequence[float], left: float
    ) -> tuple[float, float]:
        """Return what pushes the motor, and its friction with so much left of that at rest."""
        passed = self.passed(side, *state)
        cogs = -self.cogging * math.sin(self.periods * state[0] + self.phase)
        friction = self.coulomb + left * (self.static - self.coulomb)
        friction += self.load * abs(passed + stretch.torque)
        return stretch.torque + cogs - passed, friction


def integrate_coupled(
    body: Coupled, state: Sequence[float], stretches: Sequence[Stretch], tolerance: float = 1e-11
) -> list[list[float]]:
    """Positions and velocities, the motor's first, after every stretch; as ``integrate``."""
    states = []
    now = list(state)
    for stretch in stretches:
        now = _integrate_coupled(body, now, stretch, tolerance)
        states.append(now)
    return states


def _integrate_coupled(
    body: Coupled, state: list[float], stretch: Stretch, tolerance: float
) -> list[float]:
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
            push, friction = body.net(stretch, side, now, _left(v, body.stribeck))
            push -= (body.forth if sign > 0.0 else body.back) * v + sign * friction
            reference = stretch.reference + stretch.slope * t
            z, u = now[2:]
            outside = body.hand_stiffness * (reference - z) + body.hand_damping * (
                stretch.slope - u
            )
            outside -= body.gravity * math.sin(z - body.angle)
            rates = [v if sign else 0.0, push / body.inertia if sign else 0.0]
            rates += u, (body.passed(side, *now) + outside) / body.load_inertia
            return rates

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
            x, v, y, w = map(float, now[:4])
            if body.gap == 0.0 or t == begun:
                return 1.0
            if side:
                return side * body.passed(side, x, v, y, w)
            return 0.5 * body.gap - (x - y) * math.copysign(1.0, v - w)

        motor.terminal = touch.terminal = True  # type: ignore[attr-defined]
        motor.direction = touch.direction = -1.0  # type: ignore[attr-defined]
        found = solve_ivp(
            slope,
            (time, stretch.duration),
            state,
            method="DOP853",
            rtol=tolerance,
            atol=tolerance * 1e-2,
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
        state = last.tolist()
        if sign == 0.0 or stopped:
            state[1] = 0.0
        if time >= stretch.duration:
            return state
    raise AssertionError("the motion has too many events")
