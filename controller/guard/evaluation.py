"""Evaluates what the limits of a wall need, on the servos of a belief, for many delays at once.

All is in commanded units: the acting torque is the torque gain times the commanded torque, so that
theory is asked at ``gain * B`` and its answer divided by the gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import fields
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.guard.fast_vibration import (
    UNBOUND,
    fast_ceiling,
    fast_limit,
    formulas_from,
)
from haptic_wall.controller.guard.flexible import LinkLimits
from haptic_wall.controller.guard.link_servos import slices
from haptic_wall.controller.guard.plants import LIGHT, Plants, members
from haptic_wall.controller.guard.types import OF_ENCODER, GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.theory import one_sided_limit
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.one_sided_table import one_sided_limit_tabulated

_REGULAR = 1.01
"""Served interval up to which it is the period itself [periods]"""
WIDE, SLOWLY_SAMPLED = 2.0, 0.25
"""Ratio of the ends of a vibration's frequency, and cycles per interval, above both of which longer
intervals than the period are left to the formulas: a grid takes long"""
T = TypeVar("T")


class Evaluation:
    """A wall on the least safe corner of a belief at many delays; each value is computed once.

    Args:
        request: The requested wall.
        settings: The guard's settings; in mode ``off`` the damping is as requested.
        situation: The belief, torque limit and encoder step.
        corners: ``Plants.at_corner``, or changed ones.
        exact: Whether contacts are simulated for the one-sided limit, to 1e-4; else it is looked
            up, up to 5 % lower.
        asked: Requested damping of each corner; None: that of the request [N·m·s/rad].
        work: Results of earlier evaluations.
    """

    def __init__(
        self,
        request: Request,
        settings: GuardSettings,
        situation: Situation,
        corners: Plants,
        *,
        exact: bool = False,
        asked: FloatArray | None = None,
        work: Work | None = None,
    ) -> None:
        self.request = request
        self.settings = settings
        self.situation = situation
        self.corners = corners
        self.work = Work() if work is None else work
        self._simulated = exact
        self._wanted = np.full_like(corners.gain, request.damping) if asked is None else asked
        self._key = (
            (request.side, request.velocity_samples, request.velocity_filter),
            (situation.belief, situation.period, situation.inserted[0], situation.served),
            *(getattr(corners, field.name).tobytes() for field in fields(corners)),
        )

    def once(self, name: Hashable, compute: Callable[[], T]) -> T:
        """Return what ``compute`` returned for this belief, these corners and their damping."""
        return self.work.once((name, self._key, self.damping.tobytes()), compute)

    @cached_property
    def rigid_ceiling(self) -> FloatArray:
        """Return the damping above which no stiffness is stable on a rigid servo [N·m·s/rad]."""
        return self.least(self._ceilings / self._members.gain)

    @cached_property
    def _ceilings(self) -> FloatArray:
        """Return the ceiling of each member, in acting units [N·m·s/rad]."""
        p, request = self._members, self.request
        servo, filtered = one_mass(p.inertia, p.damping), request.velocity_filter
        loop = (p.period, p.delay, request.velocity_samples)
        return self.work.once(("rigid", self._key), lambda: chain_ceiling(*servo, *loop, filtered))

    @cached_property
    def vibration(self) -> FloatArray:
        """Return the same with the believed vibration of a load [N·m·s/rad]."""
        belief, rigid, p = self.situation.belief, self.rigid_ceiling, self.corners
        if not belief.is_flexible:
            return rigid
        found = rigid
        for link in self.links:
            found = np.minimum(found, link.ceiling(p.delay))
        if belief.flexible_hz.high >= self.fast_from:
            found = np.minimum(found, fast_ceiling(belief, self.fast_hz, rigid, self._periods[0]))
        return found

    @cached_property
    def links(self) -> list[LinkLimits]:
        """Return the limits of the believed load on its transmission, where no formula counts."""
        situation, request = self.situation, self.request
        return [
            LinkLimits(belief, request, situation, self.fast_from, self.work)
            for belief in slices(situation.belief)
            if belief.flexible_hz.low < self.fast_from
        ]

    @property
    def _periods(self) -> tuple[float, float]:
        served, period = self.situation.served, self.situation.period
        return served[0] * period, served[1] * period

    @cached_property
    def fast_from(self) -> float:
        """Return the frequency from which formulas count a load's vibration [Hz]."""
        belief, p, request = self.situation.belief, self.corners, self.request
        hz, longest = belief.flexible_hz, self._periods[1]
        longer = self.situation.period > _REGULAR * self.situation.sampled
        if longer and hz.high > WIDE * hz.low and hz.high * longest > SLOWLY_SAMPLED:
            return hz.low
        if self.settings.mode == "off" or request.velocity_filter is not None:
            unbound = np.full_like(p.gain, UNBOUND)
            return formulas_from(belief, unbound, unbound, self._periods)
        most = np.minimum(np.abs(self._wanted), self.settings.damping_cap * self.rigid_ceiling)
        most = np.minimum(most, OF_ENCODER * self.encoder_damping)
        limit = _critical(p, request, p.gain * most) / p.gain
        return formulas_from(belief, limit, most, self._periods)

    @property
    def fast_hz(self) -> float:
        """Return the least of these frequencies that is believed [Hz]."""
        return max(self.situation.belief.flexible_hz.low, self.fast_from)

    @property
    def fast_stiffness(self) -> FloatArray:
        """Return what the formulas allow at each corner [N·m/rad]."""
        belief, shortest = self.situation.belief, self._periods[0]
        ceiling = fast_ceiling(belief, self.fast_hz, self.rigid_ceiling, shortest)
        full = np.ones_like(ceiling)  # a load without damping allows no damping at all
        share = np.divide(np.abs(self.damping), ceiling, out=full, where=ceiling > 0.0)
        return fast_limit(belief, self.fast_hz, self.at_corner(self.exact), share, shortest)

    @cached_property
    def ceiling(self) -> FloatArray:
        """Return the damping above which no stiffness fulfils the mode's promise [N·m·s/rad]."""
        if self.settings.mode != "passive":
            return self.vibration
        # above it, for whole delays, even the damper alone is not passive
        return np.minimum(self.vibration, self.corners.damping / self.corners.gain)

    @property
    def vibrates(self) -> NDArray[np.bool_]:
        """Whether the ceiling is that of a load's vibration on its transmission."""
        return (self.vibration < self.rigid_ceiling) & (self.vibration <= self.ceiling)

    @cached_property
    def encoder_damping(self) -> FloatArray:
        """Return the damping at which one encoder count commands the most that it may.

        A loop with a fraction a of its damping ceiling amplifies the noise of its encoder, and a
        count is weighed by 1/(1 - a²). The rms of the torque at rest then stays below
        ``most_of_count``, with up to 0.34 counts rms of noise before the rounding (0.03° at 4096
        counts: data sheet of the AS5045).

        Returns:
            Of positive and negative damping [N·m·s/rad]; inf without an encoder step.
        """
        situation = self.situation
        if situation.position_step == 0 or math.isinf(situation.torque_limit):
            return np.full_like(self.corners.gain, math.inf)
        ceiling = self.rigid_ceiling
        alone = self.most_of_count / count_torque(self.request, situation)
        # the root B of B / (1 - (B / ceiling)²) = alone
        found: FloatArray = 2.0 * alone * ceiling / (ceiling + np.hypot(ceiling, 2.0 * alone))
        return found

    @property
    def most_of_count(self) -> float:
        """Return the torque that one encoder count may command [N·m]."""
        return self.settings.quantisation_share * self.situation.torque_limit

    @cached_property
    def damping(self) -> FloatArray:
        """Return the damping that may be commanded at each corner [N·m·s/rad]."""
        p, settings = self.corners, self.settings
        if settings.mode == "off":
            return self._wanted
        cap = settings.damping_cap
        found = np.minimum(self._wanted, cap * self.ceiling)
        found = np.where(found <= -p.damping / p.gain, -cap * p.damping / p.gain, found)
        most = OF_ENCODER * self.encoder_damping
        return np.clip(found, -most, most) + 0.0

    # Members of the belief around each corner

    @property
    def exact(self) -> FloatArray:
        """Return the critical stiffness of each member [N·m/rad]."""
        return self._exact_acting / self._members.gain

    @property
    def one_sided(self) -> FloatArray:
        """Return the one-sided limit of each member [N·m/rad]."""
        return self._one_sided_acting / self._members.gain

    @property
    def one_sided_share(self) -> FloatArray:
        """Return the one-sided limit of each corner over its exact limit; 0 where that is 0."""
        exact = self.at_corner(self._exact_acting)
        one_sided = self.at_corner(self._one_sided_acting)
        return np.divide(one_sided, exact, out=np.zeros_like(exact), where=exact > 0.0)

    @cached_property
    def _exact_acting(self) -> FloatArray:
        p, acting = self._members, self._acting
        return self.once("exact", lambda: _critical(p, self.request, acting))

    @cached_property
    def _one_sided_acting(self) -> FloatArray:
        return self.once(("one-sided", self._simulated), self._contacts)

    def _contacts(self) -> FloatArray:
        p = self._members
        loop = (p.inertia, p.damping, self._acting, p.period, p.delay)
        samples = self.request.velocity_samples
        if self._simulated:
            return one_sided_limit(*loop, samples)
        exact = self._exact_acting
        # longer differences are a tenth less timid, and simulated: only for the period itself
        situation, spans = self.situation, samples * p.period * p.damping
        if situation.period > _REGULAR * situation.sampled and np.all(spans <= LIGHT * p.inertia):
            samples = 1
        return one_sided_limit_tabulated(*loop, samples, exact, self._ceilings)

    @cached_property
    def _members(self) -> Plants:
        return members(self.corners, self.situation, self.request)

    @property
    def size(self) -> int:
        """Return the number of members around each corner."""
        return self._members.gain.size // self.corners.gain.size

    @property
    def _acting(self) -> FloatArray:
        return self._members.gain * np.repeat(self.damping, self.size)

    def least(self, of_members: FloatArray) -> FloatArray:
        """Return the least value over the members of each corner."""
        found: FloatArray = of_members.reshape(-1, self.size).min(axis=1)
        return found

    def at_corner(self, of_members: FloatArray) -> FloatArray:
        """Return the value at each corner itself."""
        return of_members[:: self.size]


def count_torque(request: Request, situation: Situation) -> float:
    """Return the torque of one encoder count through a damping of 1 N·m·s/rad [N·m].

    Args:
        request: The wall: its velocity samples, and its filter.
        situation: The encoder step, and the shortest interval between samples.
    """
    n, filtered = request.velocity_samples, request.velocity_filter
    peak = 1.0 if filtered is None else filtered.peak(n)
    return peak * situation.position_step / (n * min(situation.period, situation.sampled))


def _critical(plants: Plants, request: Request, acting: FloatArray) -> FloatArray:
    """Return the critical stiffness of rigid servos at an acting damping, in acting units."""
    loop = (acting, plants.period, plants.delay, request.velocity_samples)
    servo = one_mass(plants.inertia, plants.damping)
    found = chain_boundary(*servo, *loop, request.velocity_filter).stiffness
    bounded: FloatArray = np.minimum(found, UNBOUND)
    return bounded
