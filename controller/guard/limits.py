"""Evaluates the guard's limits for many plants at once, in commanded units.

The acting torque is the torque gain times the commanded torque. A limit is therefore evaluated at
``gain * B`` and divided by the gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.guard.flexible import (
    fast_ceiling,
    fast_limit,
    flexible_ceiling,
    flexible_limit,
    returned_share,
)
from haptic_wall.controller.guard.plants import Box, Plants
from haptic_wall.controller.guard.types import GuardSettings, Limits, Request, Situation
from haptic_wall.controller.theory import (
    linear_limit,
    one_sided_limit,
    passive_limit,
)
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.harmonic import backlash_limit
from haptic_wall.controller.theory.one_sided_table import one_sided_limit_tabulated
from haptic_wall.controller.theory.passivity import passive_slope

BACKLASH_COUNTS = 4
"""An oscillation of backlash of up to so many counts to either side is let be"""
_UNBOUND = 1e12
"""Stands for no limit at all [N·m/rad]"""
ON_A_LINK = 0.4
"""Fraction of the limit of a believed vibration that a two-sided law of several slopes may use: a
law of many ridges can turn the shaft in one direction for ever, where their frequency is near that
of the vibration"""
LOOKED_UP = 0.05
"""Largest fraction by which the table underestimates the one-sided limit."""

CORNER_ALONE = 0.94
"""Fraction of the corner's one-sided limit that the guard uses where friction is light: the worst
that a search found over the box is 0.943. The exact limit is used as it is at the corner: the same
search found 0.997 of it, 0.987 with velocities over several samples."""
BETWEEN_MEMBERS = 0.96
"""Fraction of the least one-sided limit over the evaluated members that the guard uses: between the
members the limit is up to 3 % lower (found by search). 1 where the
servo is known exactly."""


@dataclass(frozen=True, slots=True)
class PlantLimits:
    """Permitted damping and stiffness limits of each plant, in commanded units."""

    ceiling: FloatArray
    damping: FloatArray
    linear: FloatArray
    exact: FloatArray
    one_sided: FloatArray | None
    quantisation: FloatArray | None
    passive: FloatArray | None
    encoder_damping: FloatArray
    """As of ``Decision``"""
    rigid_ceiling: FloatArray
    """Damping above which no stiffness is stable on a rigid servo"""
    backlash: FloatArray | None = None
    flexible: FloatArray | None = None
    resolution: FloatArray | None = None
    vibrates: NDArray[np.bool_] | None = None
    """The ceiling is that of the load's vibration on its transmission"""

    def limits(self, i: int) -> Limits:
        """Return the limits of plant ``i``."""

        def at(values: FloatArray | None) -> float | None:
            return None if values is None else float(values[i])

        return Limits(**{f.name: at(getattr(self, f.name)) for f in fields(Limits)})

    def take(self, index: IntArray) -> PlantLimits:
        """Return the results of the plants at ``index``."""
        every: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        chosen: dict[str, Any] = {n: None if v is None else v[index] for n, v in every.items()}
        return PlantLimits(**chosen)

    def smallest(self) -> FloatArray:
        """Return the smallest limit of each plant [N·m/rad]."""
        named = (getattr(self, f.name) for f in fields(Limits))
        least: FloatArray = np.min([values for values in named if values is not None], axis=0)
        return least


def evaluate(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    plants: Plants,
    tolerance: float = 1e-4,
    asked: FloatArray | None = None,
) -> PlantLimits:
    """Compute the permitted damping and the stiffness limits at it.

    Args:
        request: The requested wall.
        settings: The guard's settings; in mode ``off`` the damping is as requested.
        situation: The torque limit and the encoder step.
        plants: Plants to evaluate.
        tolerance: Wanted relative accuracy of the one-sided limit. With ``LOOKED_UP`` or more it
            comes from the table, on the safe side; with less, contacts are simulated.
        asked: Requested virtual damping of each plant, where it differs from the request's
            [N·m·s/rad].
    """
    m, b, g, t, t_d = (getattr(plants, f.name) for f in fields(plants))
    n = request.velocity_samples
    belief = situation.belief
    ceiling, rigid = damping_ceiling(request, situation, plants)
    nothing_stable, vibration = g * rigid, ceiling
    most = encoder_damping(request, settings, situation, t, rigid)
    vibrates = ceiling < rigid if belief.is_flexible else None
    if settings.mode == "passive":
        # above it, for whole delays, even the damper alone is not passive
        ceiling = np.minimum(ceiling, b / g)
        vibrates = None if vibrates is None else vibrates & (vibration <= b / g)
    damping = np.full_like(ceiling, request.damping) if asked is None else asked
    if settings.mode != "off":
        damping = np.minimum(damping, settings.damping_cap * ceiling)
        damping = np.where(damping <= -b / g, -settings.damping_cap * b / g, damping)
        damping = np.clip(damping, -most, most) + 0.0
    acting = g * damping
    filtered = request.velocity_filter
    exact = _critical(plants, request, acting)
    one_sided = None
    if request.side != "both":
        one_sided = (
            one_sided_limit(m, b, acting, t, t_d, n, tolerance)
            if tolerance < LOOKED_UP
            else one_sided_limit_tabulated(
                m, b, acting, t, t_d, n, exact=exact, ceiling=nothing_stable
            )
        )
    flexible = None
    shortest = situation.served[0]
    if belief.is_fast(shortest * situation.period):
        full = np.ones_like(damping)  # a load without damping allows no virtual damping at all
        of_ceiling = np.divide(damping, vibration, out=full, where=vibration > 0.0)
        flexible = fast_limit(belief, exact / g, of_ceiling, shortest * t)
    elif belief.is_flexible:
        served = situation.served
        flexible = flexible_limit(belief, t, t_d, damping, n, situation.inserted, filtered, served)
        if one_sided is not None:
            rigid_share = np.divide(one_sided, exact, out=np.zeros_like(exact), where=exact > 0.0)
            flexible = flexible * returned_share(belief, flexible) * np.minimum(rigid_share, 1.0)
        elif not request.linear:
            flexible = ON_A_LINK * flexible
    return PlantLimits(
        ceiling=ceiling,
        damping=damping,
        linear=linear_limit(b, acting, t, t_d, n) / g,
        exact=exact / g,
        one_sided=None if one_sided is None else one_sided / g,
        quantisation=quantisation_limit(request, settings, situation, damping, t, rigid),
        encoder_damping=most,
        rigid_ceiling=rigid,
        passive=_passive(request, plants, acting) if settings.mode == "passive" else None,
        flexible=flexible,
        resolution=None if math.isinf(request.resolved) else np.full_like(g, request.resolved),
        vibrates=vibrates,
    )


def _passive(request: Request, plants: Plants, acting: FloatArray) -> FloatArray:
    """Return the stiffness below which the law is passive [N·m/rad].

    Args:
        request: The law.
        plants: To be evaluated.
        acting: Virtual damping that acts [N·m·s/rad].
    """
    b, t, t_d = plants.damping, plants.period, plants.delay
    if request.linear:
        limit = passive_limit(b, acting, t, t_d, request.velocity_samples)
    else:
        limit = passive_slope(b, acting, t, t_d)
    found: FloatArray = limit / plants.gain
    return found


def damping_ceiling(
    request: Request, situation: Situation, plants: Plants
) -> tuple[FloatArray, FloatArray]:
    """Return the commanded damping above which no stiffness is stable [N·m·s/rad].

    Args:
        request: The wall; only its number of velocity samples is used.
        situation: The belief, and the period.
        plants: Plants to evaluate.

    Returns:
        (with the believed vibration, of a rigid servo)
    """
    g, t, t_d = plants.gain, plants.period, plants.delay
    n, belief = request.velocity_samples, situation.belief
    filtered = request.velocity_filter
    rigid = _ceiling(plants, request) / g
    if belief.is_fast(situation.served[0] * situation.period):
        return np.minimum(rigid, fast_ceiling(belief, rigid)), rigid
    if belief.is_flexible:
        found = flexible_ceiling(belief, t, t_d, n, situation.inserted, filtered, situation.served)
        return np.minimum(rigid, found), rigid
    return rigid, rigid


def evaluate_box(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    corners: Plants,
    tolerance: float = 1e-4,
    asked: FloatArray | None = None,
) -> PlantLimits:
    """Compute the same as ``evaluate``, with each limit the least over the whole belief.

    The permitted damping comes from the corners, where the ceiling is least. At that damping each
    limit is evaluated at members of the belief's box around each corner.

    Args:
        request: As for ``evaluate``.
        settings: As for ``evaluate``.
        situation: As for ``evaluate``; its belief's bounds are the box.
        corners: ``Plants.at_corner``, or changed corners.
        tolerance: As for ``evaluate``.
        asked: As for ``evaluate``, one for each corner.
    """
    unlimited = replace(situation, torque_limit=math.inf)
    found = _kept(request, settings, unlimited, corners, tolerance, asked)
    period, ceiling = corners.period, found.rigid_ceiling
    most = encoder_damping(request, settings, situation, period, ceiling)
    if settings.mode != "off" and np.any(np.abs(found.damping) > most):
        clipped = np.clip(found.damping, -most, most)
        found = _kept(request, settings, unlimited, corners, tolerance, clipped)
    return replace(
        found,
        encoder_damping=most,
        quantisation=quantisation_limit(
            request, settings, situation, found.damping, period, ceiling
        ),
    )


_MOST_EVALUATED = 64
_evaluated: dict[tuple[object, ...], PlantLimits] = {}
"""Cached results without a torque limit. A servo may report its torque limit only after its start,
with torque on; that change alone must not cause a new evaluation."""


def _kept(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    corners: Plants,
    tolerance: float,
    asked: FloatArray | None,
) -> PlantLimits:
    """Compute ``_evaluate_box``, or return what it computed before."""
    key = (
        request,
        settings,
        situation,
        *(getattr(corners, f.name).tobytes() for f in fields(corners)),
        tolerance,
        None if asked is None else asked.tobytes(),
    )
    found = _evaluated.get(key)
    if found is None:
        if len(_evaluated) >= _MOST_EVALUATED:
            _evaluated.clear()
        found = _evaluated[key] = _evaluate_box(
            request, settings, situation, corners, tolerance, asked
        )
    return found


def _evaluate_box(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    corners: Plants,
    tolerance: float,
    asked: FloatArray | None,
) -> PlantLimits:
    """Compute ``evaluate_box`` without the cache."""
    at_corner = evaluate(request, settings, situation, corners, tolerance, asked)
    box = Box.of(situation)
    at_members = at_corner
    if box.size > 1:
        at_members = evaluate(
            request,
            replace(settings, mode="off"),
            situation,
            box.around(corners),
            tolerance,
            np.repeat(at_corner.damping, box.size),
        )

    def least(values: FloatArray) -> FloatArray:
        found: FloatArray = values.reshape(-1, box.size).min(axis=1)
        return found

    known = situation.belief.is_known
    at_corner = replace(at_corner, exact=least(at_members.exact))
    if at_members.one_sided is not None:
        share = 1.0 if known else BETWEEN_MEMBERS if box.size > 1 else CORNER_ALONE
        at_corner = replace(at_corner, one_sided=share * least(at_members.one_sided))
    if situation.belief.backlash.high > 0.0:
        backlash = backlash_over_box(request, situation, corners, at_corner.damping)
        at_corner = replace(at_corner, backlash=backlash)
    if at_corner.passive is not None and request.linear:
        at_corner = replace(
            at_corner,
            passive=passive_over_delays(request, situation, corners, at_corner.damping),
        )
    return at_corner


def backlash_over_box(
    request: Request, situation: Situation, corners: Plants, damping: FloatArray
) -> FloatArray:
    """Return the least backlash limit over the belief's inertias and gains [N·m/rad].

    Friction is at its lowest, and counts: without it backlash would allow no wall at all.

    Args:
        request: The wall; only its number of velocity samples is used.
        situation: The belief, and the encoder step.
        corners: The corners.
        damping: Commanded virtual damping at each [N·m·s/rad].
    """
    belief = situation.belief
    width = belief.backlash.high
    amplitude = BACKLASH_COUNTS * situation.position_step or width
    found = [
        backlash_limit(
            inertia,
            corners.damping,
            belief.coulomb.low,
            gain * damping,
            corners.period,
            corners.delay,
            width,
            amplitude,
            request.velocity_samples,
        )
        / gain
        for inertia in {belief.inertia.low, belief.inertia.high}
        for gain in {belief.torque_gain.low, belief.torque_gain.high}
    ]
    least: FloatArray = np.min(found, axis=0)
    return np.minimum(least, _UNBOUND)


def passive_over_delays(
    request: Request, situation: Situation, corners: Plants, damping: FloatArray
) -> FloatArray:
    """Return the least passive limit over the delays that the belief admits [N·m/rad].

    Args:
        request: The wall; only its number of velocity samples is used.
        situation: The belief.
        corners: The corners, with the longest delay.
        damping: Commanded virtual damping at each [N·m·s/rad].
    """
    lag, period = situation.belief.delay, situation.period
    longest = corners.delay
    shortest = np.maximum(longest - (lag.high - lag.low), 0.0)
    # between two whole periods the limit has its maximum inside, so it is least at a whole period
    # or at the ends of the range
    count = int((lag.high - lag.low) / period) + 2
    whole = np.ceil(shortest / corners.period)[:, None] + np.arange(count)
    delays = np.concatenate(
        [longest[:, None], shortest[:, None], whole * corners.period[:, None]], 1
    )
    delays = np.clip(delays, shortest[:, None], longest[:, None])
    rows = [corners.damping, corners.gain * damping, corners.period]
    every = np.stack([*(np.repeat(row, delays.shape[1]) for row in rows), delays.ravel()])
    # many corners share the same whole delays, and each evaluation takes half a millisecond
    distinct, which = np.unique(every, axis=1, return_inverse=True)
    b, acting, t, t_d = distinct
    limits = passive_limit(b, acting, t, t_d, request.velocity_samples)[which.ravel()]
    least: FloatArray = limits.reshape(delays.shape).min(axis=1) / corners.gain
    return least


def count_torque(request: Request, situation: Situation, period: FloatArray) -> FloatArray:
    """Return the torque of one encoder count through a damping of 1 N·m·s/rad [N·m].

    Args:
        request: The wall: its velocity samples, and its filter.
        situation: The encoder step, and the shortest interval between samples.
        period: Period of each plant [s].
    """
    n, filtered = request.velocity_samples, request.velocity_filter
    peak = 1.0 if filtered is None else filtered.peak(n)
    found: FloatArray = peak * situation.position_step / (n * np.minimum(period, situation.sampled))
    return found


def encoder_damping(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    period: FloatArray,
    ceiling: FloatArray,
) -> FloatArray:
    """Return the damping at which one count commands ``quantisation_share`` of the torque limit.

    A loop with a fraction a of its damping ceiling amplifies the noise of its encoder, and a count
    is weighed by 1/(1 - a²). The rms of the torque at rest then stays below the share, with up to
    0.34 counts rms of noise before the rounding (0.03° at 4096 counts: data sheet of the AS5045).

    Args:
        request: The wall: its velocity samples, and its filter.
        settings: The fraction of the torque limit.
        situation: The torque limit and the encoder step.
        period: Period of each plant [s].
        ceiling: ``PlantLimits.rigid_ceiling`` [N·m·s/rad].

    Returns:
        Of positive and negative damping [N·m·s/rad]; inf without an encoder step.
    """
    if situation.position_step == 0 or math.isinf(situation.torque_limit):
        return np.full_like(period, math.inf)
    allowed = settings.quantisation_share * situation.torque_limit
    alone = allowed / count_torque(request, situation, period)
    # the root B of B / (1 - (B / ceiling)²) = alone
    found: FloatArray = 2.0 * alone * ceiling / (ceiling + np.hypot(ceiling, 2.0 * alone))
    return found


def quantisation_limit(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    damping: FloatArray,
    period: FloatArray,
    ceiling: FloatArray,
) -> FloatArray | None:
    """Return the stiffness at which one count commands ``quantisation_share`` of the torque limit.

    The damper's part is weighed by 1/(1 - a²)², a the fraction of the ceiling: a spring near its
    own limit amplifies the noise again.

    Args:
        request: As for ``encoder_damping``.
        settings: As for ``encoder_damping``.
        situation: As for ``encoder_damping``.
        damping: Commanded virtual damping [N·m·s/rad].
        period: Period of each plant [s].
        ceiling: As for ``encoder_damping``.

    Returns:
        [N·m/rad]; None without an encoder step.
    """
    step = situation.position_step
    if step == 0 or math.isinf(situation.torque_limit):
        return None
    magnitude = np.abs(damping)
    by_damper = magnitude * count_torque(request, situation, period)
    left = np.ones_like(by_damper)
    np.divide(magnitude, ceiling, out=left, where=ceiling > magnitude)
    left = np.where(magnitude > 0.0, 1.0 - left**2, 1.0) ** 2
    allowed = settings.quantisation_share * situation.torque_limit * left - by_damper
    found: FloatArray = np.divide(
        np.maximum(allowed, 0.0), left * step, out=np.zeros_like(left), where=left > 0.0
    )
    return found


def unstable_nominally(
    request: Request, situation: Situation, before_device: FloatArray
) -> NDArray[np.bool_]:
    """Whether the requested wall is unstable for the nominal belief without friction.

    Args:
        request: The requested wall.
        situation: The belief.
        before_device: Delay without the device's own lag [s].
    """
    p = Plants.nominal(situation, before_device)
    acting = p.gain * request.damping
    if request.stiffness > 0:
        unstable: NDArray[np.bool_] = p.gain * request.stiffness >= _critical(p, request, acting)
        return unstable
    runs_away: NDArray[np.bool_] = (acting < -p.damping) | (acting >= _ceiling(p, request))
    return runs_away


def _critical(plants: Plants, request: Request, acting: FloatArray) -> FloatArray:
    """Return the critical stiffness of rigid servos at an acting damping, in acting units."""
    loop = (acting, plants.period, plants.delay, request.velocity_samples)
    servo = one_mass(plants.inertia, plants.damping)
    found = chain_boundary(*servo, *loop, request.velocity_filter).stiffness
    bounded: FloatArray = np.minimum(found, _UNBOUND)
    return bounded


def _ceiling(plants: Plants, request: Request) -> FloatArray:
    """Return the damping above which no rigid servo is stable, in acting units."""
    loop = (plants.period, plants.delay, request.velocity_samples)
    return chain_ceiling(*one_mass(plants.inertia, plants.damping), *loop, request.velocity_filter)
