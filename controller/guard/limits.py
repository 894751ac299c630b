"""The limits of the guard: one class each, and their list. All else iterates over the list.

Decisions, reasons, reports, the table of ``haptic-wall boundary``, pictures and the live page's map
take names, meanings and values from here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from haptic_wall.controller.guard.evaluation import Evaluation, count_torque
from haptic_wall.controller.guard.fast_vibration import UNBOUND
from haptic_wall.controller.theory import linear_limit, passive_limit
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.harmonic import backlash_limit
from haptic_wall.controller.theory.one_sided import returned_share
from haptic_wall.controller.theory.passivity import passive_slope


class Limit(Protocol):
    """A limit of the stiffness."""

    name: str
    """In reports and on pages"""
    label: str
    """In pictures and tables"""
    meaning: str
    """What happens above it, as the end of a sentence"""
    source: str

    def applies(self, at: Evaluation, /) -> bool:
        """Whether it limits this wall."""

    def stiffness(self, at: Evaluation, /) -> FloatArray:
        """Return it at the commanded damping of each corner [N·m/rad]."""


class Linear:
    """(b + B) / (T/2 + t_d): the tangent of the exact boundary at the origin."""

    name, label = "linear", "linear condition"
    meaning = "sum of the damping over sum of the delay"
    source = "Gil et al., ICRA 2007, (7) to (10)"

    def applies(self, _: Evaluation) -> bool:
        """Always."""
        return True

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return it at the corner, where it is least."""
        p = at.corners
        found: FloatArray = linear_limit(p.damping, p.gain * at.damping, p.period, p.delay) / p.gain
        return found


class Exact:
    """The two-sided loop is stable below it."""

    name, label = "exact", "exact"
    meaning = "above it the loop oscillates and grows"
    source = "Gil et al., ICRA 2007, (11)"

    def applies(self, _: Evaluation) -> bool:
        """Always."""
        return True

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return the least of the members."""
        return at.least(at.exact)


class OneSided:
    """Below it a wall that never pulls returns no device faster than it came."""

    name, label = "one_sided", "one-sided"
    meaning = "above it a wall that never pulls returns the device faster than it came"
    source = "simulated contacts"

    CORNER_ALONE = 0.94
    """Fraction of the corner's limit that is used where friction is light: the worst that a search
    found over the box is 0.943. The exact limit is used as it is at the corner: the same search
    found 0.997 of it, 0.987 with velocities over several samples."""
    BETWEEN_MEMBERS = 0.96
    """Fraction of the least of the members that is used: between them it is up to 3 % lower (found
    by search). 1 where the servo is known exactly."""

    def applies(self, at: Evaluation) -> bool:
        """To walls that never pull."""
        return at.request.side != "both"

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return a fraction of the least of the members."""
        share = self.BETWEEN_MEMBERS if at.size > 1 else self.CORNER_ALONE
        if at.situation.belief.is_known:
            share = 1.0
        return share * at.least(at.one_sided)


class Quantisation:
    """Below it one encoder count commands a small fraction of the torque limit."""

    name, label = "quantisation", "encoder (quantisation)"
    meaning = "above it one encoder count commands too much of the torque limit"
    source = "Diolaiti et al. 2006"

    def applies(self, at: Evaluation) -> bool:
        """Where position and torque limit are known to be finite."""
        situation = at.situation
        return situation.position_step > 0 and not math.isinf(situation.torque_limit)

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return what the damper leaves.

        Its part is weighed by 1/(1 - a²)², a the fraction of the ceiling: a spring near its own
        limit amplifies the noise again.
        """
        magnitude, ceiling = np.abs(at.damping), at.rigid_ceiling
        by_damper = magnitude * count_torque(at.request, at.situation)
        left = np.ones_like(by_damper)
        np.divide(magnitude, ceiling, out=left, where=ceiling > magnitude)
        left = np.where(magnitude > 0.0, 1.0 - left**2, 1.0) ** 2
        allowed = at.most_of_count * left - by_damper
        found: FloatArray = np.divide(
            np.maximum(allowed, 0.0),
            left * at.situation.position_step,
            out=np.zeros_like(left),
            where=left > 0.0,
        )
        return found


class Passive:
    """Below it the wall is stable with any passive hand."""

    name, label = "passive", "passive"
    meaning = "above it some passive hand makes the wall unstable"
    source = "Colgate and Schenkel 1997"

    def applies(self, at: Evaluation) -> bool:
        """In mode ``passive``."""
        return at.settings.mode == "passive"

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return the least over the delays that the belief admits; of a law, at the longest."""
        return at.once("passive", lambda: self._over_delays(at))

    def _over_delays(self, at: Evaluation) -> FloatArray:
        p, lag, period = at.corners, at.situation.belief.delay, at.situation.period
        acting = p.gain * at.damping
        if not at.request.linear:
            slope: FloatArray = passive_slope(p.damping, acting, p.period, p.delay) / p.gain
            return slope
        shortest = np.maximum(p.delay - (lag.high - lag.low), 0.0)
        # between two whole periods the limit has its maximum inside, so it is least at a whole
        # period or at the ends of the range
        count = int((lag.high - lag.low) / period) + 2
        whole = np.ceil(shortest / p.period)[:, None] + np.arange(count)
        delays = [p.delay[:, None], shortest[:, None], whole * p.period[:, None]]
        tried = np.clip(np.concatenate(delays, 1), shortest[:, None], p.delay[:, None])
        rows = (np.repeat(row, tried.shape[1]) for row in (p.damping, acting, p.period))
        # many corners share the same whole delays, and each evaluation takes half a millisecond
        distinct, which = np.unique(np.stack([*rows, tried.ravel()]), axis=1, return_inverse=True)
        b, big_b, t, t_d = distinct
        limits = passive_limit(b, big_b, t, t_d, at.request.velocity_samples)[which.ravel()]
        least: FloatArray = limits.reshape(tried.shape).min(axis=1) / p.gain
        return least


class Backlash:
    """Below it backlash sustains no oscillation of more than four encoder counts."""

    name, label = "backlash", "backlash"
    meaning = (
        "above it the believed backlash may sustain an oscillation that friction does not stop"
    )
    source = "Gelb and Vander Velde 1968"

    COUNTS = 4
    """An oscillation of up to so many counts to either side is let be"""

    def applies(self, at: Evaluation) -> bool:
        """Where backlash is believed."""
        return at.situation.belief.backlash.high > 0.0

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return the least over inertias and gains, with the least friction, which counts here."""
        return at.once(("backlash", at.situation.position_step), lambda: self._over_box(at))

    def _over_box(self, at: Evaluation) -> FloatArray:
        belief, p = at.situation.belief, at.corners
        width = belief.backlash.high
        amplitude = self.COUNTS * at.situation.position_step or width
        inertia = np.unique([belief.inertia.low, belief.inertia.high])[:, None, None]
        gain = np.unique([belief.torque_gain.low, belief.torque_gain.high])[:, None]
        loop = (gain * at.damping, p.period, p.delay, width, amplitude, at.request.velocity_samples)
        found = backlash_limit(inertia, p.damping, belief.coulomb.low, *loop) / gain
        least: FloatArray = found.min(axis=(0, 1))
        return np.minimum(least, UNBOUND)


class Flexible:
    """Below it a load behind a flexible transmission does not vibrate, nor return faster."""

    name, label = "flexible", "flexible load"
    meaning = "above it the believed load may vibrate on its flexible transmission"
    source = "two masses, exactly discretised"

    ON_A_LINK = 0.4
    """Fraction that a two-sided law of several slopes may use: a law of many ridges can turn the
    shaft in one direction for ever, where their frequency is near that of the vibration"""

    def applies(self, at: Evaluation) -> bool:
        """Where such a load is believed."""
        return at.situation.belief.is_flexible

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return the least over the belief's whole box."""
        p, request, situation = at.corners, at.request, at.situation
        belief = situation.belief
        found = np.full_like(at.damping, UNBOUND)
        for link in at.links:
            found = np.minimum(found, link.stiffness(p.delay, at.damping))
        if belief.flexible_hz.high >= at.fast_from:
            found = np.minimum(found, at.fast_stiffness)
            if belief.is_light and belief.flexible_hz.low >= at.fast_from:
                return found
        if request.side == "both":
            return found if request.linear else self.ON_A_LINK * found
        servo = (belief.inertia.low, belief.flexible_hz.low)
        share = returned_share(*servo, belief.torque_gain.high * found)
        return found * share * np.minimum(at.one_sided_share, 1.0)


class Resolution:
    """Below it a law that slips travels four encoder counts first."""

    name, label = "resolution", "resolution"
    meaning = "above it friction slips before the encoder has seen it bend"
    source = "four counts"

    def applies(self, at: Evaluation) -> bool:
        """To such a law."""
        return not math.isinf(at.request.resolved)

    def stiffness(self, at: Evaluation) -> FloatArray:
        """Return what the law's numbers say."""
        return np.full_like(at.damping, at.request.resolved)


PASSIVE = Passive()
LIMITS: tuple[Limit, ...] = (
    Linear(),
    Exact(),
    OneSided(),
    Quantisation(),
    PASSIVE,
    Backlash(),
    Flexible(),
    Resolution(),
)
BY_NAME: Mapping[str, Limit] = {each.name: each for each in LIMITS}


def smallest(limits: Mapping[str, float | None]) -> tuple[str, float]:
    """Return name and value of the smallest limit that applies."""
    known = [(name, value) for name, value in limits.items() if value is not None]
    return min(known, key=lambda pair: pair[1])


def evaluate(at: Evaluation) -> dict[str, FloatArray]:
    """Return each limit that applies, at the commanded damping of each corner [N·m/rad]."""
    return {each.name: each.stiffness(at) for each in LIMITS if each.applies(at)}


def least_of(limits: Mapping[str, FloatArray]) -> FloatArray:
    """Return the smallest of the limits at each corner [N·m/rad]."""
    least: FloatArray = np.min([*limits.values()], axis=0)
    return least
