"""Computes where a fit begins: a regression of the smoothed acceleration, which assumes no values.

    x'' = gain u(t - delay) - damping x' - coulomb sign(x') - sine sin x - cosine cos x

All values are per inertia.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import savgol_filter

from haptic_wall.controller.experiments.identify.motion import Motion
from haptic_wall.controller.theory.checks import FloatArray

SMOOTH_S = 0.021
"""Window of the smoothing, where samples are 1 ms apart [s]"""
_SLOW = 0.15
"""Fraction of the largest speed below which the sign of the speed is not certain"""


def smoothed(motion: Motion, over_s: float = SMOOTH_S) -> tuple[FloatArray, FloatArray] | None:
    """Return speed [rad/s] and acceleration [rad/s²] at each sample; None: the motion is too short.

    Args:
        motion: The recorded motion.
        over_s: Window of the smoothing [s].
    """
    period = float(np.median(np.diff(motion.sampled)))
    window = max(7, 2 * round(0.5 * over_s / period) + 1)
    # On an even grid: losses and missed periods are interpolated.
    even = np.arange(motion.sampled[0], motion.sampled[-1], period)
    if even.size <= window:
        return None
    position = np.interp(even, motion.sampled, motion.position)
    smooth = [savgol_filter(position, window, 3, deriv=n, delta=period) for n in (1, 2)]
    speed, acceleration = (np.interp(motion.sampled, even, s) for s in smooth)
    return speed, acceleration


def start_of(
    motions: Sequence[Motion],
    delays: Sequence[float],
    over_s: float = SMOOTH_S,
    *,
    weight: bool = False,
) -> dict[str, float]:
    """Return friction, weight and, where a motor is on, gain and delay, per inertia.

    Args:
        motions: At least one.
        delays: Delays that are tried [s].
        over_s: Window of the smoothing [s].
        weight: A torque that depends on the angle is looked for.
    """
    names = ("damping", "coulomb", *(("sine", "cosine") if weight else ()), "gain")
    best, least = dict.fromkeys((*names, "delay"), 0.0), np.inf
    columns, targets, acting = [np.zeros((0, len(names) - 1))], [np.zeros(0)], []
    for motion in motions:
        found = smoothed(motion, over_s)
        if found is None:
            continue
        speed, acceleration = found
        moving = np.abs(speed) > _SLOW * np.max(np.abs(speed))
        own = [-speed, -np.sign(speed)]
        if weight:
            own += [-np.sin(motion.position), -np.cos(motion.position)]
        columns.append(np.column_stack(own)[moving])
        targets.append(acceleration[moving])
        acting.append(_acting(motion, delays, over_s)[:, moving])
    column, target = np.concatenate(columns), np.concatenate(targets)
    for delay, torque in zip(delays, np.hstack(acting) if acting else (), strict=bool(acting)):
        every = np.column_stack([column, torque])
        values = np.linalg.lstsq(every, target, rcond=1e-10)[0]
        left = float(np.sum((every @ values - target) ** 2))
        if left < least:
            best, least = dict(zip((*names, "delay"), [*values.tolist(), delay], strict=True)), left
    if not any(motion.driven for motion in motions):
        del best["gain"], best["delay"]
    return best


def _acting(motion: Motion, delays: Sequence[float], over_s: float) -> FloatArray:
    """Return the torque at each sample, smoothed as the motion is [N·m], for each delay [s]."""
    grid = np.linspace(motion.sent[0], motion.sent[-1], 4 * motion.sent.size)
    held = motion.torque[np.searchsorted(motion.sent, grid, side="right") - 1]
    window = max(7, 2 * round(0.5 * over_s / float(grid[1] - grid[0])) + 1)
    smooth = savgol_filter(held, min(window, held.size - 1 + held.size % 2), 3)
    return np.array([np.interp(motion.sampled - delay, grid, smooth) for delay in delays])
