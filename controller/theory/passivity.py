"""Passivity: the stiffness up to which a wall is stable with any passive hand on the device.

Seen from the sampled position at the angle ``theta`` (rad/sample), every passive hand puts the
admittance of device and hand in one disk at each of the aliases that a sampled, held torque
excites. Their sum is a disk too, and the loop is stable with every hand iff that disk, turned by
the wall and the delay, stays clear of -1. With ``d = n + f`` periods of delay the condition is,
for all 0 < theta <= pi::

    1 + 2 Re(L c) - |L|² (1 - |c|²) > 0
    L = -H (1 - e^{-j theta}) e^{-j d theta} T / (8 b sin²(theta/2))
    H = K + (B / (N T)) (1 - e^{-j N theta})
    c = e^{j theta f} ((1 - f) + f e^{-j theta})     (the fraction turns the aliases)

and ``1 - |c|² = 4 f (1 - f) sin²(theta/2)``, which makes it quadratic in K at each theta.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.dimensionless import settings

_ZOOMS = 12
_ZOOM_POINTS = 9
_BLOCK, _MOST_ANGLES = 256, 1 << 17
"""Most walls that are scanned at a time, and most angles of all, so that the memory stays small"""
_NEVER_PASSIVE = 1e9  # B / b: at some angle the damper alone injects more than b dissipates


def passive_limit(
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> FloatArray:
    """Return the stiffness up to which the wall is stable with any passive hand on the device.

    It does not depend on the inertia. Without delay it is 2 (b - abs(B)) / T; for B = 0 and whole
    delays it is the linear condition b / (T/2 + t_d). It holds for a linear, two-sided wall.

    Args:
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N of the velocity difference, >= 1.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape; 0 where no stiffness is passive.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Colgate and Schenkel, J. Robotic Systems 14(1), 1997, extended to any delay.
    """
    s = settings(1.0, damping, virtual_damping, period, delay, velocity_samples)
    # per unit of b/T, so that the numbers are near 1
    undamped = s.delta == 0
    with np.errstate(over="ignore"):
        ratio = s.beta / np.where(undamped, 1.0, s.delta)
    ratio = np.clip(ratio, -_NEVER_PASSIVE, _NEVER_PASSIVE)
    kappa = np.empty_like(ratio)
    alike: dict[tuple[float, int], list[int]] = {}
    loops = zip(s.delay.tolist(), s.samples.astype(int).tolist(), strict=True)
    for row, loop in enumerate(loops):
        alike.setdefault(loop, []).append(row)
    for loop, rows in alike.items():
        size = max(1, min(_BLOCK, _MOST_ANGLES // _steps(*loop)))
        for start in range(0, len(rows), size):
            block = rows[start : start + size]
            kappa[block] = _kappa(ratio[block], *loop)
    return s.shaped(np.where(undamped, 0.0, kappa * s.delta * s.stiffness_unit))


def _steps(delay: float, n_samples: int) -> int:
    """Return the number of scanned steps: sixteen per turn of the fastest angle."""
    return 64 + 8 * int((delay + 2) + n_samples)


def _kappa(ratio: FloatArray, delay: float, n_samples: int) -> FloatArray:
    """Return the largest K T / b at each B / b = ``ratio``: the least over theta, by scan and zoom.

    Args:
        ratio: Shape (n,).
        delay: [periods].
        n_samples: Samples of the velocity difference.
    """
    steps = _steps(delay, n_samples)
    theta = np.linspace(0.0, np.pi, steps + 1)
    theta[0] = 1e-7  # the limit theta -> 0
    values = _kappa_at(theta, ratio[:, None], delay, n_samples)
    found: FloatArray = values.min(axis=1)
    beside = np.full((ratio.size, steps + 3), np.inf)
    beside[:, 1:-1] = values
    before, after = beside[:, :-2], beside[:, 2:]
    # every local minimum may contain the least value, if it can be low enough: a smooth minimum is
    # below its lowest point by an eighth of the rise beside it at most
    row, low = np.nonzero(
        (values <= before)
        & (values <= after)
        & (2.0 * values < found[:, None] + np.maximum(before, after))
    )
    left, right = theta[np.maximum(low - 1, 0)], theta[np.minimum(low + 1, steps)]
    for _ in range(_ZOOMS):
        points = left[:, None] + (right - left)[:, None] * np.linspace(0.0, 1.0, _ZOOM_POINTS)
        zoomed = _kappa_at(points, ratio[row, None], delay, n_samples)
        lows, best = np.arange(row.size), np.argmin(zoomed, axis=1)
        one, other = np.maximum(best - 1, 0), np.minimum(best + 1, _ZOOM_POINTS - 1)
        least = zoomed[lows, best]
        np.minimum.at(found, row, least)
        kept = 2.0 * least < found[row] + np.maximum(zoomed[lows, one], zoomed[lows, other])
        row, left, right = row[kept], points[lows, one][kept], points[lows, other][kept]
    return found


def passive_slope(
    damping: ArrayLike, virtual_damping: ArrayLike, period: ArrayLike, delay: ArrayLike
) -> FloatArray:
    """Return the slope of torque up to which any law of position is passive with any passive hand.

    A sampled law acts on the position of up to ``t_d + T`` ago. Its torque thus differs by at most
    ``L |x(t) - x(t_k)|`` from that of a spring without delay, which gives back no more than it
    took. With the inequality of Cauchy and Schwarz the difference injects at most
    ``L (t_d + T) ∫ v² dt``, and the delayed damper at most ``|B| ∫ v² dt``; friction dissipates
    ``b ∫ v² dt``. The slope may have either sign.

    Args:
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].

    Returns:
        Largest slope L [N·m/rad] in the broadcast shape; 0 where none is passive.
    """
    b, virtual, t, t_d = (np.asarray(x, float) for x in (damping, virtual_damping, period, delay))
    least: FloatArray = np.maximum(b - np.abs(virtual), 0.0) / (t_d + t)
    return least


def _kappa_at(theta: FloatArray, ratio: FloatArray, delay: float, n_samples: int) -> FloatArray:
    """Return the largest K T / b that meets the condition at ``theta``, from a quadratic.

    The condition times b, with k = K T / b and h = ratio (1 - e^{-jN theta}) / N::

        free - k (slope + 2 a Re h) - a k² > 0
    """
    whole = int(delay)
    f = delay - whole
    a = f * (1 - f) / 4
    half = 2 * np.sin(theta / 2)

    def turned(offset: float, theta: FloatArray) -> FloatArray:
        """Angle pair of the two taps of c, weighted; real part of -j e^{-j(n+1/2+offset) theta}."""
        first = (whole + 0.5 + offset) * theta
        weighted: FloatArray = (1 - f) * np.sin(first) + f * np.sin(first + theta)
        return weighted

    h_real = ratio * 2 * np.sin(n_samples * theta / 2) ** 2 / n_samples
    h_square = (ratio * 2 * np.sin(n_samples * theta / 2) / n_samples) ** 2
    held = turned(0.0, theta)
    slope = held / half
    by_damping = ratio / n_samples * (held - turned(n_samples, theta)) / half
    free = 1 - by_damping - a * h_square
    linear = slope + 2 * a * h_real
    root = linear + np.sqrt(np.maximum(linear**2 + 4 * a * free, 0.0))
    kappa = np.where(root > 0, 2 * free / np.where(root > 0, root, 1.0), np.inf)
    return np.where(free > 0, kappa, 0.0)
