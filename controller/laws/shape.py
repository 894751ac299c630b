"""The shape of a law: its elastic torque over position, with a steepest slope of one.

A law's elastic torque is ``-K e(x)``. The elongation ``e`` [rad] is scaled so that its slope stays
within -1 and 1: K, which the guard commands, is the steepest slope of the torque. The guard needs
little more: whether there is more than one slope, and where damping acts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from haptic_wall.controller.laws.wall import Side


class Shape(Protocol):
    """Elongation over position; positions count from ``wall.position`` [rad].

    Attributes:
        lowest_slope: Least slope of the elongation, from -1 to 1 [1].
        highest_slope: Highest slope, from -1 to 1 [1]; one of the two is 1 or -1, or both are 0.
        damped_everywhere: Damping acts at every position. Otherwise it acts in contact only, and
            the law never pulls.
        steepest: Its steepest part, for people; empty: the whole law.
    """

    @property
    def lowest_slope(self) -> float: ...  # noqa: D102

    @property
    def highest_slope(self) -> float: ...  # noqa: D102

    @property
    def damped_everywhere(self) -> bool: ...  # noqa: D102

    @property
    def steepest(self) -> str: ...  # noqa: D102

    def elongation(self, away: float, speed: float, stiffness: float) -> float:
        """Return e [rad]; call once a tick where the shape has state.

        Args:
            away: Position [rad].
            speed: Estimated velocity [rad/s].
            stiffness: Present K [N·m/rad].
        """
        ...

    def potential(self, away: float) -> float:
        """Return the integral of e from its lowest point [rad²], >= 0: K times it is the energy."""
        ...

    def in_contact(self, away: float) -> bool:
        """Whether the law acts at this position."""
        ...

    def settle(self, away: float) -> None:
        """Start at rest at this position, where the shape has state."""
        ...

    def resolved(self, step: float) -> float:
        """Return the highest K [N·m/rad] at which encoder steps [rad] still resolve the shape."""
        ...


@dataclass(frozen=True, slots=True)
class Grid:
    """The grid of time and position on which a law is rendered."""

    period: float
    """Sampling period [s]"""
    step: float
    """Encoder step [rad]; 0: the position is not quantised"""


class Numbers(Protocol):
    """The numbers of a law: a section of the configuration, or a part of a sum."""

    @property
    def law(self) -> str: ...  # noqa: D102

    @property
    def side(self) -> Side: ...  # noqa: D102

    @property
    def low(self) -> float | None: ...  # noqa: D102

    @property
    def high(self) -> float | None: ...  # noqa: D102

    @property
    def count(self) -> int | None: ...  # noqa: D102

    @property
    def width(self) -> float | None: ...  # noqa: D102

    @property
    def snap(self) -> float: ...  # noqa: D102

    @property
    def friction(self) -> float | None: ...  # noqa: D102

    @property
    def period(self) -> float | None: ...  # noqa: D102

    @property
    def profile(self) -> Sequence[tuple[float, float]] | None: ...  # noqa: D102

    @property
    def parts(self) -> Sequence[Part]: ...  # noqa: D102

    @property
    def options(self) -> Mapping[str, Any]: ...  # noqa: D102


class Part(Numbers, Protocol):
    """A part of a sum."""

    @property
    def share(self) -> float: ...  # noqa: D102


class LawError(ValueError):
    """Raised for numbers that make no law.

    Args:
        field: Name of the number, without ``wall.``.
        found: What was found.
        wanted: What is wanted.
    """

    def __init__(self, field: str, found: str, wanted: str) -> None:
        super().__init__(f"{field}: {found}, wanted {wanted}")
        self.field, self.found, self.wanted = field, found, wanted


class Memoryless:
    """The common part of shapes that have no state and that any encoder resolves."""

    __slots__ = ()
    damped_everywhere: bool = True
    steepest: str = ""

    def in_contact(self, away: float) -> bool:  # noqa: ARG002 - whatever the position
        """Return true: the law acts at every position."""
        return True

    def settle(self, away: float) -> None:
        """Do nothing: there is no state."""

    def resolved(self, step: float) -> float:  # noqa: ARG002 - whatever the step
        """Return infinity: no stiffness is too high for the encoder."""
        return float("inf")
