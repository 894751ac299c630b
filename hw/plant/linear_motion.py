"""Computes the linear motion of a chain of masses under held torques, exactly.

The state is a list: the motor's speed, then for each further mass the twist of the joint before it
and its speed, and last the stretch of the operator's spring. The inputs are held: torques on motor,
output (the second mass) and end (the last one), and the speed of the operator's reference.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from haptic_wall.hw.settings import Link

if TYPE_CHECKING:
    import numpy as np

_TERMS = 24
"""Terms of a course: those of a piece fall at least as 2^k / k!"""
_REACH = 2.0
"""Largest norm of the rates times the length of a piece"""
_SMALL = 1e-18
"""Relative size of a last term that no longer counts"""
_LOOKS = 8
"""Parts of a piece in which a root is looked for"""


Inputs = tuple[float, float, float, float]
"""Held torques on motor, output and last mass [N·m], and the reference's speed [rad/s]"""


class LinearMotion:
    """One linear motion of a chain; responses over few lengths are kept."""

    __slots__ = ("_kept", "_orders", "_piece_ns", "_rates", "_scale", "_series")

    def __init__(
        self,
        inertia: float,
        links: tuple[Link, ...],
        viscous: float,
        hand_stiffness: float,
        hand_damping: float,
        sticks: bool,
    ) -> None:
        """Prepare.

        Args:
            inertia: Inertia of the motor's side [kg·m²].
            links: The masses behind it, each with its joint; a joint's stiffness and damping are 0
                within its backlash.
            viscous: Friction of the motor [N·m·s/rad].
            hand_stiffness: Stiffness of the operator's spring at the last mass [N·m/rad].
            hand_damping: Damping of the operator's damper [N·m·s/rad].
            sticks: The motor's side stands still.
        """
        import numpy as np  # not at the top: of an emulated bus it is half the start

        size = 2 * len(links) + 2
        speeds = range(0, size - 1, 2)
        rates = np.zeros((size, size + 4))
        motor, output, end, slope = range(size, rates.shape[1])
        rates[0, 0], rates[0, motor], rates[2, output], rates[-2, end] = -viscous, 1.0, 1.0, 1.0
        for i, (_, stiffness, damping) in zip(speeds, links, strict=False):
            rates[i, i : i + 3] += -damping, -stiffness, damping
            rates[i + 1, [i, i + 2]] = 1.0, -1.0
            rates[i + 2, i : i + 3] += damping, stiffness, -damping
        rates[-2, [size - 2, size - 1, slope]] += -hand_damping, hand_stiffness, hand_damping
        rates[-1, [size - 2, slope]] = -1.0, 1.0
        for i, mass in zip(speeds, (inertia, *(link.inertia for link in links)), strict=True):
            rates[i] /= mass
        if sticks:
            rates[0] = 0.0
        self._rates = rates
        bends = np.abs(rates[::2][:, [*range(1, size, 2)]]).sum(axis=1).max()
        fades = np.abs(rates[::2][:, list(speeds)]).sum(axis=1).max()
        rate = math.sqrt(float(bends))
        self._scale = np.ones(rates.shape[1])
        if rate > 0.0:  # twists count as speeds
            self._scale[1:size:2] = rate
        self._piece_ns = max(int(_REACH / max(2.0 * rate, rate + float(fades), 1.0) * 1e9), 1)
        self._kept: dict[int, np.ndarray[Any, Any]] = {}
        self._orders = np.arange(_TERMS)
        self._series: np.ndarray[Any, Any] | None = None

    def after(self, now: Iterable[float], held: Inputs, length_ns: int) -> list[float]:
        """Return the state after a length that comes often [ns]."""
        over = self._kept.get(length_ns)
        if over is None:
            import numpy as np
            from scipy.linalg import expm

            rows, columns = self._rates.shape
            whole = np.zeros((columns, columns))
            whole[:rows] = self._rates * (length_ns * 1e-9)
            scale = self._scale
            over = (expm(whole * scale[:, None] / scale) / scale[:, None] * scale)[:rows]
            self._kept[length_ns] = over
        state: list[float] = over.dot((*now, *held)).tolist()
        return state

    def course(self, now: Sequence[float], held: Inputs, length_ns: int) -> Course:
        """Return the course over a step [ns]."""
        if self._series is None:
            self._series = self._powers()
        piece_ns, size = self._piece_ns, len(now)
        pieces = [self._series.dot((*now, *held)).reshape(_TERMS, size)]
        for _ in range((length_ns - 1) // piece_ns):
            now = self.after(now, held, piece_ns)
            pieces.append(self._series.dot((*now, *held)).reshape(_TERMS, size))
        return Course(length_ns, piece_ns, pieces, self._orders)

    def _powers(self) -> np.ndarray[Any, Any]:
        """Return the matrices of the terms of a piece, one below the other."""
        import numpy as np

        size, columns = self._rates.shape
        moved = self._rates * (self._piece_ns * 1e-9)
        series = np.zeros((_TERMS, size, columns))
        series[0, :, :size], series[1] = np.eye(size), moved
        for k in range(2, _TERMS):
            series[k] = moved[:, :size] @ series[k - 1] / k
        return series.reshape(-1, columns)


linear_motion = lru_cache(maxsize=256)(LinearMotion)
"""Linear motions are kept, with their responses"""


class Course:
    """The motion over one step: in each of its pieces, powers of the share that has passed."""

    __slots__ = ("_length_ns", "_orders", "_piece_ns", "_pieces")

    def __init__(
        self,
        length_ns: int,
        piece_ns: int,
        pieces: list[np.ndarray[Any, Any]],
        orders: np.ndarray[Any, Any],
    ) -> None:
        self._length_ns, self._piece_ns = length_ns, piece_ns
        self._pieces, self._orders = pieces, orders

    def at(self, time_ns: int) -> list[float]:
        """Return the state at this time of the step [ns]."""
        index = min(time_ns // self._piece_ns, len(self._pieces) - 1)
        share = time_ns / self._piece_ns - index
        state: list[float] = (share**self._orders).dot(self._pieces[index]).tolist()
        return state

    def until(self, offset: float, motor: float, twist: float, output: float) -> int:
        """Return the first nanosecond at which a positive value has fallen to 0 or below.

        The value is ``offset`` and the multiples of the motor's speed, of the first twist and of
        the output's speed that are given. Where it is nowhere positive, at eight points of each
        piece, that is the first nanosecond.
        """
        piece_ns, length_ns = self._piece_ns, self._length_ns
        was: bool | None = None
        for index, piece in enumerate(self._pieces):
            terms = piece[:, :3].dot((motor, twist, output)).tolist()
            terms[0] += offset
            small = _SMALL * max(map(abs, terms))
            while len(terms) > 1 and abs(terms[-1]) <= small:
                terms.pop()
            terms.reverse()
            start_ns = index * piece_ns
            last = min((length_ns - start_ns) / piece_ns, 1.0)
            low = 0.0
            if was is None:
                was = terms[-1] > 0.0
            for k in range(1, _LOOKS + 1):
                high = last * k / _LOOKS
                positive = _value(terms, high) > 0.0
                if was and not positive:
                    step = 0.5 / piece_ns
                    while high - low > step:
                        middle = 0.5 * (low + high)
                        if _value(terms, middle) > 0.0:
                            low = middle
                        else:
                            high = middle
                    return min(max(1, start_ns + math.ceil(high * piece_ns)), length_ns)
                low, was = high, positive
        return length_ns if was else 1


def _value(terms: Sequence[float], share: float) -> float:
    value = 0.0
    for term in terms:
        value = value * share + term
    return value
