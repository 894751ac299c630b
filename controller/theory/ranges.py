"""Ranges of a servo's parameters, and a single member of them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from haptic_wall.controller.theory.checks import number


@dataclass(frozen=True, slots=True)
class Member:
    """One servo of a range."""

    inertia: float
    """[kg·m²]"""
    damping: float
    """[N·m·s/rad]"""
    delay: float
    """Total delay, from the sample to its torque acting [s]"""
    torque_gain: float = 1.0
    """Ratio of the acting torque to the commanded torque"""


@dataclass(frozen=True, slots=True)
class Ranges:
    """Ranges of a servo's parameters: the lowest and the highest of each, which may be equal.

    Raises:
        ValueError: A bound is outside of its domain, or they are not in order; the message names
            the field.
    """

    inertia: tuple[float, float]
    """> 0 [kg·m²]"""
    damping: tuple[float, float]
    """> 0 [N·m·s/rad]: without any, nothing damps the motion before the wall acts"""
    delay: tuple[float, float]
    """Total delay, from the sample to its torque acting, >= 0 [s]"""
    torque_gain: tuple[float, float] = (1.0, 1.0)
    """Ratio of the acting torque to the commanded torque, > 0; only the highest matters"""

    def __post_init__(self) -> None:
        for field in fields(self):
            bounds = number(field.name, getattr(self, field.name))
            if bounds.shape != (2,):
                raise ValueError(f"{field.name} must be a pair (low, high), got {bounds.tolist()}")
            low, high = bounds.tolist()
            if field.name == "delay" and low < 0:
                raise ValueError(f"delay must be >= 0, got {low:g}")
            if field.name != "delay" and low <= 0:
                raise ValueError(f"{field.name} must be > 0, got {low:g}")
            if low > high:
                raise ValueError(f"{field.name} must have low <= high, got {low:g} > {high:g}")

    def known(self, name: str, value: float) -> Ranges:
        """Return the ranges with one parameter known exactly.

        Raises:
            ValueError: ``value`` is outside of the range.
        """
        low, high = getattr(self, name)
        if not low <= value <= high:
            raise ValueError(f"{name} must be within {low:g} to {high:g}, got {value:g}")
        match name:
            case "inertia":
                return replace(self, inertia=(value, value))
            case "damping":
                return replace(self, damping=(value, value))
            case "delay":
                return replace(self, delay=(value, value))
            case _:
                return replace(self, torque_gain=(value, value))
