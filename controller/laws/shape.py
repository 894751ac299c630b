"""Defines the shape of a law: its elastic torque over position, scaled to a steepest slope of 1.

A law's elastic torque is ``-K e(x)``. The elongation ``e`` [rad] is scaled so that its slope stays
within -1 and 1: K, which the guard commands, is the steepest slope of the torque. Besides K the
guard needs only two facts: whether the slope varies, and where damping acts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from haptic_wall.controller.laws.wall import Side


class Shape:
    """Elongation over position; positions count from ``wall.position`` [rad].

    What is not overridden is that of a shape without state that any encoder resolves.

    Attributes:
        lowest_slope: Lowest slope of the elongation, from -1 to 1 [1].
        highest_slope: Highest slope, from -1 to 1 [1]. One of the two slopes is 1 or -1, or both
            are 0.
        damped_everywhere: Damping acts at every position. Otherwise it acts in contact only, and
            the law never pulls.
        stores_work: The potential is the work of the elongation on every path, at any speed:
            passivity control counts on it.
        steepest: Name of the steepest part, for messages; empty: the whole law.
        lowest: Two positions with a lowest point of the potential between them [rad].
        resolved: Highest K at which the encoder resolves the shape [N·m/rad].
        own_stiffness: K that the law itself asks for [N·m/rad]; None: ``wall.stiffness``.
    """

    lowest_slope: float
    highest_slope: float
    damped_everywhere: bool = True
    stores_work: bool = True
    steepest: str = ""
    lowest: tuple[float, float] = 0.0, 0.0
    resolved: float = math.inf
    own_stiffness: float | None = None

    def elongation(self, away: float, speed: float, stiffness: float) -> float:
        """Return the elongation e [rad]; call it once a tick, because the shape may have state.

        Args:
            away: Position [rad].
            speed: Estimated velocity [rad/s].
            stiffness: Present K [N·m/rad].
        """
        raise NotImplementedError

    def potential(self, away: float) -> float:
        """Return the integral of e, >= 0 [rad²]; K times this is the stored energy."""
        raise NotImplementedError

    def in_contact(self, away: float) -> bool:  # noqa: ARG002 - at every position
        """Whether the law acts at this position."""
        return True

    def settle(self, away: float) -> None:
        """Reset the shape's state to rest at this position."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Sampling period and encoder step with which a law is rendered."""

    period: float
    """Sampling period [s]"""
    step: float
    """Encoder step [rad]; 0: the position is not quantised"""


class Numbers(Protocol):
    """A configured law, or one part of a law that is a sum; it has the numbers of ``LAWS`` too."""

    @property
    def law(self) -> str: ...  # noqa: D102

    @property
    def side(self) -> Side: ...  # noqa: D102

    @property
    def parts(self) -> Sequence[Part]: ...  # noqa: D102

    @property
    def options(self) -> Mapping[str, Any]: ...  # noqa: D102


class Part(Numbers, Protocol):
    """The numbers of one part of a law that is a sum."""

    @property
    def share(self) -> float: ...  # noqa: D102


class LawError(ValueError):
    """Raised if the numbers do not define a law.

    Args:
        field: Name of the number, without ``wall.``.
        found: What was found.
        wanted: What is wanted.
    """

    def __init__(self, field: str, found: str, wanted: str) -> None:
        super().__init__(f"{field}: {found}, wanted {wanted}")
        self.field, self.found, self.wanted = field, found, wanted
