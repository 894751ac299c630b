"""Computes the linear motion of two masses under held torques, exactly.

The state is the twist of the transmission, the motor's speed, the output's, and the stretch of the
operator's spring; the inputs are the held torques on motor and output and the speed of the
operator's reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

_SMALL = 1e-16
"""Terms of a course that are this small no longer count [rad, rad/s]"""
_TERMS = 60
_LOOKS = 8
"""Parts of a step in which a root is looked for"""


class Moving(NamedTuple):
    """State of two masses."""

    twist: float
    """Motor's position less the output's [rad]"""
    motor: float
    """[rad/s]"""
    output: float
    """[rad/s]"""
    stretch: float
    """Reference of the operator less the output's position [rad]"""


class Inputs(NamedTuple):
    """The inputs, held during a step."""

    motor: float
    """Torque on the motor's side [N·m]"""
    output: float
    """Torque on the output [N·m]"""
    slope: float
    """Speed of the operator's reference [rad/s]"""


class LinearMotion:
    """One linear motion of two masses; responses over few lengths are kept."""

    __slots__ = ("_kept", "_rates", "_rows")

    def __init__(
        self,
        inertia: float,
        load_inertia: float,
        stiffness: float,
        damping: float,
        viscous: float,
        hand_stiffness: float,
        hand_damping: float,
        sticks: bool,
    ) -> None:
        """Prepare.

        Args:
            inertia: Inertia of the motor's side [kg·m²].
            load_inertia: [kg·m²]
            stiffness: Stiffness of the transmission; 0 within its backlash [N·m/rad].
            damping: Damping [N·m·s/rad], at the same place as the stiffness.
            viscous: Friction of the motor [N·m·s/rad].
            hand_stiffness: Stiffness of the operator's spring at the output [N·m/rad].
            hand_damping: Damping of the operator's damper [N·m·s/rad].
            sticks: The motor's side stands still.
        """
        import numpy as np  # not at the top: of an emulated bus it is half the start

        rates = np.zeros((7, 7))
        rates[0, 1:3] = 1.0, -1.0
        if not sticks:
            rates[1, :5] = -stiffness, -damping - viscous, damping, 0.0, 1.0
            rates[1] /= inertia
        rates[2, :4] = stiffness, damping, -damping - hand_damping, hand_stiffness
        rates[2, 5:] = 1.0, hand_damping
        rates[2] /= load_inertia
        rates[3, [2, 6]] = -1.0, 1.0
        self._rates = rates
        self._rows = (*rates[1, [0, 1, 2, 4]].tolist(), *rates[2, [0, 1, 2, 3, 5, 6]].tolist())
        self._kept: dict[int, tuple[float, ...]] = {}

    def after(self, now: Moving, held: Inputs, length_ns: int) -> Moving:
        """Return the state after a length that comes often [ns]."""
        over = self._kept.get(length_ns)
        if over is None:
            from scipy.linalg import expm

            whole = expm(self._rates * (length_ns * 1e-9))
            over = self._kept[length_ns] = tuple(whole[:4].ravel().tolist())
        a, b, c, d = now
        p, q, r = held
        a0, b0, c0, d0, p0, q0, r0, a1, b1, c1, d1, p1, q1, r1 = over[:14]
        a2, b2, c2, d2, p2, q2, r2, a3, b3, c3, d3, p3, q3, r3 = over[14:]
        return Moving(
            a0 * a + b0 * b + c0 * c + d0 * d + p0 * p + q0 * q + r0 * r,
            a1 * a + b1 * b + c1 * c + d1 * d + p1 * p + q1 * q + r1 * r,
            a2 * a + b2 * b + c2 * c + d2 * d + p2 * p + q2 * q + r2 * r,
            a3 * a + b3 * b + c3 * c + d3 * d + p3 * p + q3 * q + r3 * r,
        )

    def course(self, now: Moving, held: Inputs, length_ns: int) -> Course:
        """Return the course over a step of less than some radians of the motion [ns]."""
        a, b, c, d = now
        p, q, r = held
        ba, bb, bc, bp, ca, cb, cc, cd, cq, cr = self._rows
        seconds = length_ns * 1e-9
        factor, terms = seconds, [now]
        constant_b, constant_c, constant_d = bp * p, cq * q + cr * r, r
        for k in range(2, _TERMS):
            a, b, c, d = (
                factor * (b - c),
                factor * (ba * a + bb * b + bc * c + constant_b),
                factor * (ca * a + cb * b + cc * c + cd * d + constant_c),
                factor * (constant_d - c),
            )
            constant_b = constant_c = constant_d = 0.0
            terms.append(Moving(a, b, c, d))
            if abs(a) + abs(b) + abs(c) + abs(d) < _SMALL:
                break
            factor = seconds / k
        return Course(length_ns, terms)


linear_motion = lru_cache(maxsize=256)(LinearMotion)
"""Linear motions are kept, with their responses"""


class Course:
    """The motion over one step, as powers of the share of it that has passed."""

    __slots__ = ("_length_ns", "_terms")

    def __init__(self, length_ns: int, terms: list[Moving]) -> None:
        self._length_ns = length_ns
        self._terms = terms[::-1]

    def at(self, time_ns: int) -> Moving:
        """Return the state at this time of the step [ns]."""
        share = time_ns / self._length_ns
        a = b = c = d = 0.0
        for e, f, g, h in self._terms:
            a, b, c, d = a * share + e, b * share + f, c * share + g, d * share + h
        return Moving(a, b, c, d)

    def until(self, offset: float, twist: float, motor: float, output: float) -> int:
        """Return the first nanosecond at which a positive value has fallen to 0 or below.

        The value is ``offset`` and the multiples of twist and speeds that are given. Where it is
        nowhere positive, at eight points of the step, that is the first nanosecond.
        """
        terms = [twist * a + motor * b + output * c for a, b, c, _ in self._terms]
        terms[-1] += offset
        low, was = 0.0, _value(terms, 0.0) > 0.0
        high = 0.0
        for k in range(1, _LOOKS + 1):
            high = k / _LOOKS
            positive = _value(terms, high) > 0.0
            if was and not positive:
                break
            low, was = high, positive
        else:
            return self._length_ns if was else 1
        step = 0.5 / self._length_ns
        while high - low > step:
            middle = 0.5 * (low + high)
            if _value(terms, middle) > 0.0:
                low = middle
            else:
                high = middle
        return min(max(1, -int(-high * self._length_ns // 1)), self._length_ns)


def _value(terms: Sequence[float], share: float) -> float:
    value = 0.0
    for term in terms:
        value = value * share + term
    return value
