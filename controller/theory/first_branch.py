"""Solves the boundary on its first branch by Newton's method: the whole boundary for light damping.

For one-sample differences (``D = s (s/2 + j c)``, names as in ``loop``) the curve is::

    beta(w) = Q / (c M),    alpha(w) = s (P - s Q / (2 c)) / M

On the first branch ``beta`` rises from -delta at w = 0 to the ceiling at ``w_max``, where alpha is
zero again: there the phase of F has turned by half a circle against that of D. One equation with
one solution gives the ceiling, and another one gives each limit. That takes three evaluations of
the curve for the ceiling and six for a limit; a scan takes two hundred. The number of Newton steps
is fixed, because on arrays a test of convergence costs more.

The first branch is the whole boundary for light damping. With F = s |F/s| exp(j (theta - chi)),
s = 2 sin(w/2), theta = w (n + 1) - arg(b2 z + b1 + b0/z) and
tan chi = (1 - eps) cos(w/2) / ((1 + eps) sin(w/2)):

- There is one ceiling. alpha = 0 where theta - chi + w/2 = pi/2. This angle starts at -pi/2; theta
  rises and chi falls, so it passes pi/2 once.
- beta is monotone. beta = R sin(theta - chi) with R = |F| / (s cos(w/2)): from beta = 0 to the
  ceiling both factors rise. Below, beta is
  [(1 + eps) tan(w/2) sin theta - (1 - eps) cos theta] / |b2 z + b1 + b0/z|: the first part rises,
  and the second hardly changes.
- Nothing lies lower. Later |F| has grown with w² and |D| with w, so alpha >= |F| - beta |D| is
  above the first peak; at z = -1 |F(pi)| >= 6.

In 20,000 random settings up to delta = 0.5 the scan agrees to 1e-11; the first exception is at 2.7.
Above delta (d + 1) = 10 the branch is too flat: errors reach 1e-3 at 50.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.loop import HeldLoop, PlantCurve

_TINY = np.finfo(np.float64).tiny

_LIGHT = 0.5
"""Largest delta for which this is used: up to 2.7 the first branch is the whole boundary (N = 1)"""
_SHORT = 10.0
"""Largest delta (d + 1) for which this is used: beyond it the branch gets flat near the ceiling"""

# Newton steps before the last one, which also corrects the result to first order. Each squares the
# error; over the whole domain the guesses are off by up to 3e-5 and 0.2 (interpolated: 1e-4).
_CEILING_STEPS = 2
_GUESSED_STEPS, _LOOKED_UP_STEPS = 5, 1
_TABLE = 129


def holds(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> NDArray[np.bool_]:
    """Return for which settings the first branch is the whole boundary, and not too flat."""
    found: NDArray[np.bool_] = (
        (samples == 1) & (delta <= _LIGHT) & (delta * (delay + 1.0) <= _SHORT)
    )
    return found


def ceiling(loop: HeldLoop) -> tuple[FloatArray, FloatArray]:
    """Return the end of the first branch: (w_max, beta_max).

    Newton's method on the phase of ``F conj(D)``, which rises to its zero there.

    Args:
        loop: Settings with N = 1, for which it ``holds``.
    """
    # exact for small w and delta: w (d + 1) = pi/2 + atan(delta / w)
    turn = loop.delay + 1.0
    pull = loop.delta * turn
    w = (np.pi / 2 + np.arctan(pull / (np.pi / 2 + np.arctan(pull * 2 / np.pi)))) / turn
    for _ in range(_CEILING_STEPS):
        w = w + _to_ceiling(loop.curve(w))
    at = loop.curve(w)
    step = _to_ceiling(at)
    width = at.c * at.m
    return w + step, (at.q + _rise(at) * step) / width


def _to_ceiling(at: PlantCurve) -> FloatArray:
    phase = np.arctan2(0.5 * at.q * at.s - at.p * at.c, 0.5 * at.p * at.s + at.q * at.c)
    step: FloatArray = -phase / ((at.p * at.dq - at.q * at.dp) / (at.p * at.p + at.q * at.q) + 0.5)
    return step


def _rise(at: PlantCurve) -> FloatArray:
    """Return the slope d beta / d w, times c M."""
    rise: FloatArray = at.dq - at.q * (at.dm / at.m - 0.25 * at.s / at.c)
    return rise


def crossing(
    loop: HeldLoop, beta: FloatArray, w_max: FloatArray, beta_max: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the point where the first branch passes ``beta``: (alpha, w).

    Newton's method in w², in which the branch is nearly straight.

    Args:
        loop: Settings with N = 1, for which it ``holds``.
        beta: Virtual damping, -delta < beta < beta_max.
        w_max: From ``ceiling``.
        beta_max: From ``ceiling``.
    """
    share = (beta + loop.delta) / (beta_max + loop.delta)
    if loop.delta.size == 1 and beta.size > _TABLE:
        w, steps = _looked_up(loop, share, w_max, beta_max), _LOOKED_UP_STEPS
    else:
        w, steps = _guessed(loop, share, w_max, beta_max), _GUESSED_STEPS
    for _ in range(steps):
        w = np.minimum(_closer(loop.curve(w), beta, w), w_max)
    at = loop.curve(w)
    closer = _closer(at, beta, w)
    real = at.p / at.m
    slope = at.c * (real - beta * at.s) + at.s * (at.dp - real * at.dm) / at.m
    return at.s * (real - 0.5 * at.s * beta) + slope * (closer - w), closer


def _closer(at: PlantCurve, beta: FloatArray, w: FloatArray) -> FloatArray:
    excess = (at.q - beta * (at.c * at.m)) / np.maximum(_rise(at), _TINY)
    closer: FloatArray = np.sqrt(np.maximum(w * (w - 2.0 * excess), 0.0))
    return closer


def _guessed(
    loop: HeldLoop, share: FloatArray, w_max: FloatArray, beta_max: FloatArray
) -> FloatArray:
    # the branch starts as beta = w² (d + 1/2) (1 + delta (d + 1/2) / 2) - delta
    half = loop.delay + 0.5
    bend = half * (1.0 + 0.5 * loop.delta * half) * w_max * w_max
    start = np.sqrt((beta_max + loop.delta) / bend)
    guess: FloatArray = w_max * np.sqrt(share) * (start + (1.0 - start) * share)
    return guess


def _looked_up(
    loop: HeldLoop, share: FloatArray, w_max: FloatArray, beta_max: FloatArray
) -> FloatArray:
    """Return a guess by interpolation in the branch, for many settings of one plant."""
    w = w_max * np.linspace(0.0, 1.0, _TABLE)
    at = loop.curve(w)
    shares = (at.q / (at.c * at.m) + loop.delta) / (beta_max + loop.delta)
    shares[0] = 0.0
    guess: FloatArray = np.sqrt(np.interp(share, shares, w * w))
    return guess
