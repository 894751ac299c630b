"""Computes the one-sided limit: the stiffness up to which a contact adds no speed to the device.

A wall that only pushes loses its damping on the way out. It can therefore return a device faster
than it came although the two-sided loop is stable: with a gentle steady push the device then
bounces for ever. The limit is the stiffness at which the ratio of the speeds, at the worst phase of
entry, is 1.
No closed form is known: contacts are simulated. A load that vibrates takes a share of the limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.chain import Chain
from haptic_wall.controller.theory.checks import (
    FloatArray,
    IntArray,
    positive,
    scalar,
)
from haptic_wall.controller.theory.contact import Contacts, exit_speed
from haptic_wall.controller.theory.dimensionless import settings
from haptic_wall.controller.theory.exact import critical_stiffness

_FIRST = np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
_LOWER = np.array([0.002, 0.05, 0.1, 0.15, 0.2, 0.25])
_COARSE_PHASES = 9
_PHASES = 17
_ZOOMS, _ZOOM_POINTS = 4, 7
# Contacts slower than this (rad per sample, times the delay) are scaled up: see _speed_up.
_SLOW = 1e-2
_LATEST = 1e4  # longest simulated delay, in periods
_LITTLE = 1e-2  # upper end of the scaled damping (per period, times the delay)
_FLOOR = 0.5  # of ``exit_speed``: only ratios near 1 matter to the limit

_NO_COASTING = 20.0
"""A device with more viscous damping (delta) loses its speed within a twentieth of a period: it
never coasts into a wall or out of it, and no contact returns speed. Only the exact limit applies.
"""
_CONTACT, _RETURNED = (0.1, 0.15, 0.3, 0.5), (0.96, 0.87, 0.6, 0.47)
"""Frequency of a contact over the vibration's, and the share of the limit that returns no more"""


def one_sided_limit(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    tolerance: float = 1e-4,
) -> FloatArray:
    """Return the stiffness up to which a one-sided wall returns no device faster than it came.

    It is at most ``critical_stiffness``, and lower the more virtual damping there is. It neglects
    torque saturation and all friction but viscous.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N of the velocity difference, >= 1.
        tolerance: Wanted relative accuracy; 0.01 or more takes a third of the time. The error can
            reach three times the default where the ratio hardly depends on the stiffness (contacts
            of thousands of periods with little virtual damping).

    Returns:
        Stiffness [N·m/rad] in the broadcast shape; 0 where none will do.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    s = settings(inertia, damping, virtual_damping, period, delay, velocity_samples)
    if np.any(s.delay > _LATEST):
        raise ValueError(f"period is too small: t_d / T must be at most {_LATEST:g} for a contact")
    wanted = scalar(positive, "tolerance", tolerance)
    alpha = np.zeros_like(s.delta)
    exact = critical_stiffness(1.0, s.delta, s.beta, 1.0, s.delay, s.samples)
    alpha = np.where(s.delta > _NO_COASTING, exact, alpha)
    some = np.flatnonzero((exact > 0) & (s.delta <= _NO_COASTING))
    if some.size:
        chosen = _Walls(s.delta[some], s.beta[some], s.delay[some], s.samples[some], exact[some])
        faster, scale = _speed_up(chosen)
        share = _share_of_exact(faster, quick=wanted >= 0.01)
        alpha[some] = exact[some] * (1 - (1 - share) / scale)
    return s.shaped(alpha * s.stiffness_unit)


def one_sided_with_load(
    chain: Chain,
    exact: FloatArray,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    tolerance: float = 1e-4,
) -> FloatArray:
    """Return a stiffness up to which a one-sided wall returns no motor with a load faster.

    It is the exact limit, times the share of it that a rigid servo of the same inertia has, times
    ``returned_share``: below the limit of simulated contacts.

    Args:
        chain: The servo: one chain of two masses.
        exact: The chain's exact limit, in the broadcast shape of what follows [N·m/rad].
        virtual_damping: As of ``one_sided_limit``, and so are the others.
        period: T > 0 [s].
        delay: t_d [s].
        velocity_samples: N.
        tolerance: Wanted relative accuracy.
    """
    inertias, damping = chain.inertias[0], float(chain.dampings[0].sum())
    inertia = float(inertias.sum())
    rigid = (inertia, damping, virtual_damping, period, delay, velocity_samples)
    alone = critical_stiffness(*rigid)
    share = np.divide(
        one_sided_limit(*rigid, tolerance), alone, out=np.zeros_like(exact), where=alone > 0.0
    )
    hz = float(np.sqrt(chain.stiffnesses[0, 0] * np.sum(1.0 / inertias))) / math.tau
    limit: FloatArray = exact * returned_share(inertia, hz, exact) * share
    return limit


def returned_share(inertia: float, hz: float, stiffness: FloatArray) -> FloatArray:
    """Return the share of the two-sided limit up to which a contact leaves little vibration.

    A contact leaves energy in the vibration of a load, the more the nearer its own frequency,
    sqrt(K/m), comes to the vibration's. The share lies below the results of exact contacts of
    random servos, for every damping, delay and encoder (``scripts/study guard``).

    Args:
        inertia: Inertia of motor and load, or less [kg·m²].
        hz: Frequency of the vibration with both ends free [Hz].
        stiffness: The two-sided limits [N·m/rad].
    """
    near = np.sqrt(stiffness / inertia) / (math.tau * hz)
    found: FloatArray = np.interp(near, _CONTACT, _RETURNED)
    return found


class _Walls(NamedTuple):
    """Flat dimensionless settings, each with a stiffness whose fractions are tried."""

    delta: FloatArray
    beta: FloatArray
    delay: FloatArray
    samples: FloatArray
    alpha: FloatArray

    def take(self, index: IntArray) -> _Walls:
        return _Walls(*(each[index] for each in self))


def _even(count: int) -> FloatArray:
    return np.linspace(0.0, 1.0, count)


def _returned(walls: _Walls, share: FloatArray, phases: FloatArray) -> FloatArray:
    """Return exit over entry speed; walls × fractions × phases.

    Args:
        walls: The settings.
        share: Fractions of each wall's alpha to try, walls (or 1) × fractions.
        phases: Either one row of phases for all, or walls × fractions × phases.
    """
    shape = (walls.delta.size, share.shape[1], phases.shape[-1])

    def spread(a: FloatArray) -> FloatArray:
        return np.repeat(a, shape[1] * shape[2])

    contacts = Contacts(
        delta=spread(walls.delta),
        alpha=np.broadcast_to((walls.alpha[:, None] * share)[..., None], shape).ravel(),
        beta=spread(walls.beta),
        delay=spread(walls.delay),
        samples=spread(walls.samples).astype(np.int64),
        phase=np.broadcast_to(phases, shape).ravel(),
    )
    return exit_speed(contacts, _FLOOR).reshape(shape)


def _worst(walls: _Walls, share: FloatArray) -> FloatArray:
    """Return the worst ratio over the phase of entry; walls × fractions.

    With damping the worst phase is nearly always the last: the first sample inside is just missed,
    and a whole period passes without the damper. With nearly no damping the ratio is a small
    sawtooth over the phase; the neighbourhood of the worst phase is then refined where that can
    decide.
    """
    phases = _even(_PHASES)
    ratio = _returned(walls, share, phases)
    best = np.argmax(ratio, axis=2)
    worst: FloatArray = np.max(ratio, axis=2)
    spread = worst - np.min(ratio, axis=2)
    row, column = np.nonzero((best < _PHASES - 1) & (np.abs(worst - 1) < spread))
    if not row.size:
        return worst
    near = walls.take(row)
    tried = share[row, column][:, None]
    best = best[row, column]
    left, right = phases[np.maximum(best - 1, 0)], phases[best + 1]
    rows = np.arange(row.size)
    for _ in range(_ZOOMS):
        points = left[:, None] + (right - left)[:, None] * _even(_ZOOM_POINTS)
        closer = _returned(near, tried, points[:, None, :])[:, 0]
        best = np.argmax(closer, axis=1)
        worst[row, column] = np.maximum(worst[row, column], closer[rows, best])
        left = points[rows, np.maximum(best - 1, 0)]
        right = points[rows, np.minimum(best + 1, _ZOOM_POINTS - 1)]
    return worst


@dataclass(slots=True)
class _Bracket:
    """Bracket, in fractions of the exact limit, in which the ratio passes 1; one for each wall."""

    low: FloatArray
    high: FloatArray
    at_low: FloatArray
    at_high: FloatArray

    def narrow(self, which: IntArray, share: FloatArray, ratio: FloatArray) -> None:
        """Keep the gap before the first of the rising fractions that returns the device faster."""
        throws = ratio > 1
        first = np.where(throws.any(axis=1), np.argmax(throws, axis=1), share.shape[1])
        rows = np.arange(which.size)
        up, down = first < share.shape[1], first > 0
        at = np.minimum(first, share.shape[1] - 1)
        self.high[which] = np.where(up, share[rows, at], self.high[which])
        self.at_high[which] = np.where(up, ratio[rows, at], self.at_high[which])
        at = np.maximum(first - 1, 0)
        self.low[which] = np.where(down, share[rows, at], self.low[which])
        self.at_low[which] = np.where(down, ratio[rows, at], self.at_low[which])

    def crossing(self) -> FloatArray:
        """Return the fraction where the ratio is 1 on the straight line between the ends."""
        rise = np.maximum(self.at_high - self.at_low, np.finfo(np.float64).tiny)
        share: FloatArray = self.low + (self.high - self.low) * (1 - self.at_low) / rise
        return share


def _share_of_exact(walls: _Walls, quick: bool) -> FloatArray:
    """Return the one-sided limit as a fraction of each wall's alpha, its exact limit.

    The ratio rises through 1 once as the stiffness grows. Several fractions at once bracket the
    crossing, which is then interpolated.

    Args:
        walls: The settings.
        quick: Interpolate in the first bracket, a tenth wide.
    """
    one = np.ones_like(walls.delta)
    at_exact = _worst(walls, one[:, None])[:, 0]
    bracket = _Bracket(0 * one, one.copy(), 0 * one, at_exact)
    some = np.flatnonzero(at_exact > 1)
    for shares in (_FIRST, _LOWER):
        tried = np.ones((some.size, 1)) * shares
        ratio = _returned(walls.take(some), tried, _even(_COARSE_PHASES))
        bracket.narrow(some, tried, np.max(ratio, axis=2))
        some = some[bracket.low[some] == 0]
    some = np.flatnonzero((at_exact > 1) & (bracket.low > 0))
    chosen = walls.take(some)

    def ends() -> tuple[FloatArray, FloatArray]:
        return bracket.low[some, None], bracket.high[some, None]

    if not quick:
        for points in (6, 4):
            low, high = ends()
            tried = low + (high - low) * _even(points + 2)
            bracket.narrow(some, tried, _worst(chosen, tried))
        low, high = ends()
        # a narrow gap around the expected crossing
        around = np.array([-0.05, 0.05]) * (high - low)
        expected: FloatArray = bracket.crossing()[some, None]
        tried = np.minimum(np.maximum(expected + around, low), high)
        bracket.narrow(some, tried, _worst(chosen, tried))
    share = np.where(bracket.low > 0, np.minimum(bracket.crossing(), 1.0), 0.0)
    return np.where(at_exact > 1, share, 1.0)


def _speed_up(walls: _Walls) -> tuple[_Walls, FloatArray]:
    """Return walls with the same fraction of the exact limit and contacts of bounded length.

    With little damping a contact takes thousands of periods. There the limit approaches the exact
    one, with a shortfall in proportion to the frequency, which goes with the root of the damping.
    Both dampings are therefore scaled up by ``scale²``, which makes the shortfall ``scale`` times
    too large. Where the stiffness is small for another reason (B next to -b, or to the ceiling) the
    dampings themselves are not small, and a contact is no oscillation: it creeps, or ends at once.

    Returns:
        (walls, scale), scale >= 1.
    """
    late = walls.delay + 1
    most = np.maximum(walls.delta, np.abs(walls.beta))
    scale = np.minimum(
        _SLOW / (np.sqrt(walls.alpha) * late), np.sqrt(_LITTLE / late) / np.sqrt(most)
    )
    scale = np.maximum(scale, 1.0)
    delta, beta = walls.delta * scale * scale, walls.beta * scale * scale
    alpha = walls.alpha
    if np.any(scale > 1):
        alpha = critical_stiffness(1.0, delta, beta, 1.0, walls.delay, walls.samples)
    return _Walls(delta, beta, walls.delay, walls.samples, alpha), scale
