"""Motion of a two-sided wall from sample to sample, where ticks come at irregular intervals.

A torque u = -(K x + B v) is computed from each sample, acts an age later, and is held until the
next one acts. v is the difference of the last two samples over the time between them. Between two
samples the state is propagated exactly, so one interval D is a matrix A(D). A repeated pattern of
intervals is stable where the product of its matrices has all eigenvalues inside the unit circle.

Times are in quarters of the period, so that ages and intervals are whole numbers of them.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

QUARTERS = 4
"""Steps of time in a period"""
PERIOD = 1e-3
"""[s]"""
_STEP = PERIOD / QUARTERS
Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Loop:
    """A servo and the damping rendered on it.

    Attributes:
        inertia: m [kg·m²].
        damping: b [N·m·s/rad].
        virtual: B [N·m·s/rad].
        age: Age of a sample when its torque acts [quarters of a period].
    """

    inertia: float
    damping: float
    virtual: float
    age: int


def interval_matrix(
    loop: Loop, stiffness: float, interval: int, measured: float, lost: int = 0
) -> Matrix:
    """A(D): from one sample to the next.

    Args:
        loop: Servo and damping.
        stiffness: K [N·m/rad].
        interval: D, from sample to sample [quarters of a period].
        measured: Divisor of the velocity difference [s].
        lost: The last part of the interval, in which readings were lost: x is held, and v is 0
            [quarters of a period].
    """
    rate = loop.damping / loop.inertia
    decay = math.exp(-rate * _STEP)
    moved = (1 - decay) / rate
    free = np.array([[1, moved], [0, decay]])
    pushed = np.array([(_STEP - moved) / loop.damping, moved / loop.inertia])
    size = 3 + loop.age  # x, v, the difference, torques on their way
    state = np.eye(size)
    spring = np.zeros(size)
    spring[0] = -stiffness
    torque = spring.copy()
    torque[2] = -loop.virtual
    for step in range(interval):
        sent = torque if step < interval - lost else spring
        acts = state[-1] if loop.age else sent
        after = state.copy()
        after[:2] = free @ state[:2] + np.outer(pushed, acts)
        if loop.age:
            after[4:], after[3] = state[3:-1], sent
        state = after
    state[2] = (state[0] - np.eye(size)[0]) / measured
    return state
