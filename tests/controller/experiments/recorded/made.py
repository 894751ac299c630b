"""Synthetic recordings of a servo with a pendulum whose truth is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

STEP = math.tau / 4096


@dataclass(frozen=True)
class Truth:
    inertia: float = 0.002
    damping: float = 0.004
    coulomb: float = 0.012
    mass: float = 0.49
    length: float = 0.1
    arm: float = 0.02
    hanging: float = -0.03
    delay: float = 0.004
    gain: float = 1.1

    @property
    def total(self) -> float:
        return self.inertia + (self.mass + self.arm / 3.0) * self.length**2

    @property
    def weight(self) -> float:
        return 9.80665 * (self.mass + 0.5 * self.arm) * self.length


def swing(
    truth: Truth, time: np.ndarray, begin: float, torque: np.ndarray | None = None
) -> np.ndarray:
    """Positions by scipy's solver, from rest at ``begin``; ``torque`` is held from row to row."""
    sent = np.zeros(time.shape) if torque is None else torque

    def acting(at: float) -> float:
        row = int(np.searchsorted(time, at - truth.delay, side="right")) - 1
        return truth.gain * float(sent[row]) if row >= 0 else 0.0

    def net(at: float, angle: float) -> float:
        return acting(at) - truth.weight * math.sin(angle - truth.hanging)

    def moves(way: float) -> Callable[[float, np.ndarray], list[float]]:
        def slope(at: float, state: np.ndarray) -> list[float]:
            push = net(at, state[0]) - truth.damping * state[1] - way * truth.coulomb
            return [state[1], push / truth.total]

        return slope

    class Stops:
        terminal = True
        direction = 0.0

        def __call__(self, _at: float, state: np.ndarray) -> float:
            return float(state[1])

    stops = Stops()

    found = np.empty(time.shape)
    found[0] = angle = begin
    at, end = float(time[0]), float(time[-1])
    filled = 0
    while at < end:
        pull = net(at, angle)
        if abs(pull) <= truth.coulomb:  # rests, until the torque has changed
            at += 2e-4
            upto = int(np.searchsorted(time, at, side="right"))
            found[filled:upto] = angle
            filled = max(filled, upto)
            continue
        way = math.copysign(1.0, pull)
        stops.direction = -way
        done = solve_ivp(
            moves(way), (at, end), [angle, way * 1e-9], events=stops, rtol=1e-8, atol=1e-10,
            max_step=0.004, dense_output=True,
        )  # fmt: skip
        upto = int(np.searchsorted(time, done.t[-1], side="right"))
        if upto > filled:
            found[filled:upto] = done.sol(time[filled:upto])[0]
            filled = upto
        at, angle = float(done.t[-1]), float(done.y[0, -1])
    found[filled:] = angle
    return found


def rounded(position: np.ndarray) -> np.ndarray:
    return np.round(position / STEP) * STEP


def table(columns: dict[str, np.ndarray]) -> str:
    """A CSV of these columns."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join([",".join(columns), *lines, ""])
