"""Holds the values with which the model explains a motion, and what follows from them.

The guard's model has inertia, viscous and Coulomb friction, delay and backlash. The effects of a
real servo are fitted beside them, so that they cannot be mistaken for these parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.identify.motion import Pieces
from haptic_wall.controller.experiments.identify.separable import (
    CORRELATED_S,
    NO_LINES,
    Linear,
    standard_covariance,
)
from haptic_wall.controller.theory.checks import FloatArray

NAMES = ("inertia", "damping", "coulomb", "delay", "backlash")
"""Values of the guard's model; the last one is not always fitted"""
VALUES: Mapping[str, str] = {
    "inertia": "[kg·m²]",
    "damping": "mean of both directions [N·m·s/rad]",
    "coulomb": "[N·m]",
    "delay": "from sending a torque until it acts [s]",
    "backlash": "between shaft and encoder [rad]",
    "excess": "friction that fades with the speed, at its largest [N·m]",
    "fading": "speed at which it has fallen to a third [rad/s]",
    "static": "friction at rest [N·m]; less than in slow motion: as there",
    "gear": "fraction of the gear's load that adds to the friction",
    "uneven": "half the difference of the damping forwards and backwards [N·m·s/rad]",
    "drag": "friction with the square of the speed [N·m·s²/rad²]",
    "dead_band": "torque that is missing of what is commanded [N·m]",
    "sine": "torque of a weight, in proportion to the sine of the position [N·m]",
    "cosine": "the same with the cosine [N·m]",
    "cogging_sine": "torque of the cogging, by the sine of its angle [N·m]",
    "cogging_cosine": "the same by the cosine [N·m]",
    "periods": "periods of the cogging in a turn",
    "center": "position at which the cogging's angle is zero [rad]",
}
"""The values, with their meanings; 0: there is no such effect"""
_SURE = {"inertia": 5e-4, "damping": 5e-4, "coulomb": 5e-4}
"""Least relative uncertainty: the spring's reaction contains rounding too"""
_SPEEDS = np.linspace(0.02, 1.0, 25)
"""Speeds at which friction is computed, over the largest of the motion"""
_WHITE = 20.0
"""Sum of the squares of the third difference's weights"""


class Friction(NamedTuple):
    """Friction of the motor at some speeds: arrays of shape (n,)."""

    speed: FloatArray
    """[rad/s]"""
    value: FloatArray
    """[N·m]"""
    stderr: FloatArray
    """[N·m]"""


@dataclass(frozen=True)
class Fit:
    """Values with their standard errors, and the start of a fit; torques in commanded units.

    Of a recorded motion all values are per inertia.
    """

    values: Mapping[str, float]
    """By name, as in ``VALUES``"""
    names: tuple[str, ...]
    """Of the values that are fitted"""
    pieces: Pieces
    own: FloatArray
    """Speed [rad/s] at the beginning of each piece, shape (1, s); of pieces that swing position
    [rad] and speed, shape (2, s)"""
    linear: Linear = NO_LINES
    """Residuals and derivatives; of a start those of an earlier fit"""
    correlated_s: float = CORRELATED_S
    """Correlation time of the residuals [s]"""
    least: float | None = None
    """Damping at least, where friction that fades with the speed may hide more [N·m·s/rad]; None:
    the standard error says how far off it may be"""

    def __getitem__(self, name: str) -> float:
        """Return a value by its name."""
        return self.values[name]

    @property
    def effects(self) -> tuple[str, ...]:
        """Return the names of the effects that are fitted."""
        return tuple(name for name in self.names if name not in NAMES)

    @property
    def terms(self) -> dict[str, float]:
        """Return the fitted values by name."""
        return {name: self.values[name] for name in self.names}

    def having(self, effects: Sequence[str] | None = None, **values: float) -> Fit:
        """Return the start of a fit with other values.

        Args:
            effects: Names of the effects to be fitted; None: the same.
            values: The values, by name; a backlash above zero is fitted.
        """
        every = {**self.values, **values}
        beside = self.effects if effects is None else effects
        count = 5 if every["backlash"] > 0.0 else 4
        return replace(self, values=every, names=(*NAMES[:count], *beside))

    @cached_property
    def covariance(self) -> FloatArray:
        """Return the covariance of the fitted values."""
        period = float(np.median(np.diff(self.pieces.motion.sampled)))
        return standard_covariance(self.linear, period, self.correlated_s)

    def error(self, *names: str) -> float:
        """Return the standard errors of some values, added as squares; 0 of one not fitted."""
        found = []
        for name in names:
            at = self.names.index(name) if name in self.names else None
            error = 0.0 if at is None else np.sqrt(self.covariance[at, at])
            found.append(float(np.hypot(error, _SURE.get(name, 0.0) * self.values[name])))
        return math.hypot(*found)

    @property
    def fitted(self) -> FloatArray:
        """Return the positions of the model [rad], shape as the pieces'."""
        return self.pieces.position + self.linear.left

    @property
    def residual(self) -> float:
        """Return the root mean square of fitted minus measured position [rad]; 0 before a fit."""
        left = self.linear.left[self.linear.weights > 0.0]
        return math.sqrt(float(np.mean(left**2))) if left.size else 0.0

    @property
    def noise(self) -> float:
        """Return the root mean square of the residual that changes at each sample [rad].

        It is the noise and the rounding of the readings: a motion that the model lacks is smooth.
        """
        changes = np.diff(self.fitted - self.pieces.position, 3, axis=1)[self.pieces.held[:, 3:]]
        return math.sqrt(float(np.mean(changes**2)) / _WHITE) if changes.size else 0.0

    def smooth_part(self, rounding: float) -> float:
        """Return the root mean square residual as if the readings had no noise but rounding [rad].

        Args:
            rounding: Root mean square of rounding [rad].
        """
        more = max(self.residual**2 - max(self.noise, rounding) ** 2, 0.0)
        return math.sqrt(more + rounding**2)

    @property
    def gravity(self) -> float:
        """Return the amplitude of the torque with the angle's period [N·m]."""
        return math.hypot(self["sine"], self["cosine"])

    @property
    def hanging(self) -> float:
        """Return the angle at which a weight would hang [rad]."""
        return math.atan2(-self["cosine"], self["sine"])

    @property
    def cogging(self) -> float:
        """Return the amplitude of the cogging [N·m]."""
        return math.hypot(self["cogging_sine"], self["cogging_cosine"])

    @property
    def weaker(self) -> tuple[float, float]:
        """Return the damping in the direction where it is less, and its standard error."""
        damping, stderr = self["damping"], self.error("damping")
        if "uneven" in self.names:
            one, other = self.names.index("damping"), self.names.index("uneven")
            sign = -1.0 if self["uneven"] > 0.0 else 1.0
            variance = self.covariance[one, one] + self.covariance[other, other]
            variance += 2.0 * sign * self.covariance[one, other]
            damping -= abs(self["uneven"])
            stderr = float(np.sqrt(max(variance, 0.0)))
        return damping if self.least is None else max(damping, self.least), stderr

    @property
    def friction(self) -> Friction:
        """Return the friction over the speeds of the motion, both directions' mean.

        The sum is known better than its parts. The gear's share of the load comes in addition.
        """
        speed = _SPEEDS * float(np.abs(self.own[-1]).max())
        slopes = {"coulomb": np.ones_like(speed), "damping": speed, "drag": speed**2}
        if "excess" in self.names:
            fading = self["fading"]
            slopes["excess"] = np.exp(-speed / fading)
            slopes["fading"] = self["excess"] * slopes["excess"] * speed / fading**2
        rows = np.array([slopes.get(name, np.zeros_like(speed)) for name in self.names])
        value = sum(self[n] * slopes[n] for n in slopes if n in self.names and n != "fading")
        variance = np.einsum("iv,ij,jv->v", rows, self.covariance, rows)
        return Friction(speed, np.asarray(value), np.sqrt(np.maximum(variance, 0.0)))
