"""Settings of the backstop."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_wall.controller.detector.tuning import TUNING, Tuning


@dataclass(frozen=True, slots=True)
class BackstopSettings:
    """Settings of the backstop: thresholds, and permitted actions."""

    period: float
    """T [s]"""
    position_step: float
    """Encoder count [rad]; 0: none"""
    threshold: float
    """Amplitude from which a motion is probed [rad]"""
    small: float
    """Amplitude from which a suspected or steady motion is probed [rad]"""
    light: float
    """Least plausible apparent inertia, in commanded torque [kg·m²]. With ``heavy`` it only decides
    how soon a motion is probed."""
    heavy: float
    """Largest plausible one [kg·m²]"""
    heaviest: float
    """Largest believed inertia, in commanded torque: decides the slowest motion at K [kg·m²]"""
    rest_torque: float
    """The gains return where the change of the elastic torque is less [N·m]."""
    torque_limit: float
    """[N·m]"""
    acts: bool = True
    """It may change the wall; else it only reports."""
    bounces: bool = False
    """It watches contacts, not half-cycles."""
    unprobed: int = TUNING.steadiness.half_cycles
    """Regular half-cycles after which a motion that must not be probed counts as steady"""
    tuning: Tuning = TUNING


def sizes(position_step: float, tuning: Tuning) -> tuple[float, float]:
    """Return ``threshold`` and ``small`` [rad] for an encoder count [rad]; 0: no encoder step."""
    least = tuning.backstop
    if not position_step:
        return least.large_rad, least.small_rad
    return least.large_counts * position_step, least.small_counts * position_step
