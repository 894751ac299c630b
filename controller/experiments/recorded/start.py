"""Computes the initial values of a fit: a regression on the smoothed motion."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from haptic_wall.controller.experiments.recorded.record import Stretch
from haptic_wall.controller.theory.checks import FloatArray

_SMOOTHED_S = 0.07
"""Length over which the motion is smoothed [s]"""
_DELAYS_S = (0.0, 0.002, 0.005, 0.01, 0.02, 0.04)
"""Delays of the torque that are tried [s]"""
_SLOW = 0.15
"""Fraction of the largest speed below which the sign of the speed is not certain"""


def start_of(stretches: tuple[Stretch, ...], *, weight: bool) -> dict[str, float]:
    """Return friction, load and, where a motor is on, gain and delay, per inertia.

    Args:
        stretches: Stretches of a record, at least one.
        weight: A load that depends on the angle is looked for.
    """
    driven = any(stretch.driven for stretch in stretches)
    best: tuple[float, dict[str, float]] | None = None
    for delay in _DELAYS_S if driven else (0.0,):
        columns, target = _rows(stretches, delay, weight=weight, driven=driven)
        found, squares = np.linalg.lstsq(columns, target, rcond=1e-10)[:2]
        left = float(squares[0]) if squares.size else float(np.sum((columns @ found - target) ** 2))
        if best is None or left < best[0]:
            values = found.tolist()
            terms = {"damping": max(values[0], 0.02), "coulomb": max(values[1], 0.05)}
            if weight:
                terms |= {"sine": values[2], "cosine": values[3]}
            if driven:
                terms |= {"gain": values[-1], "delay": max(delay, 5e-4)}
            best = left, terms
    assert best is not None
    return best[1]


def _rows(
    stretches: tuple[Stretch, ...], delay: float, *, weight: bool, driven: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the columns of the regression, and the acceleration [rad/s²]."""
    columns, targets = [], []
    for stretch in stretches:
        step = max(float(np.median(np.diff(stretch.time))), 1e-4)
        time = np.arange(stretch.time[0], stretch.time[-1], step)
        position = np.interp(time, stretch.time, stretch.position)
        window = max(7, 2 * round(0.5 * _SMOOTHED_S / step) + 1)
        if time.size <= window:
            continue
        angle, speed, acceleration = (
            savgol_filter(position, window, 3, deriv=order, delta=step) for order in range(3)
        )
        moving = np.abs(speed) > _SLOW * np.max(np.abs(speed))
        moving[: window // 2] = moving[-(window // 2) :] = False
        own = [-speed, -np.sign(speed)]
        if weight:
            own += [-np.sin(angle), -np.cos(angle)]
        if driven:
            at = np.searchsorted(stretch.time, time - delay, side="right") - 1
            sent = stretch.torque[np.maximum(at, 0)]
            own.append(savgol_filter(sent, window, 3))
        columns.append(np.column_stack(own)[moving])
        targets.append(acceleration[moving])
    if not columns:
        count = 2 + 2 * weight + driven
        return np.zeros((1, count)), np.zeros(1)
    return np.concatenate(columns), np.concatenate(targets)
