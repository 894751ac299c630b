"""Says in words which flexibility is assumed of a servo whose vibration is unknown."""

from __future__ import annotations

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.guard.types import Decision

_OF_FORMULA = 0.85
"""Least of the true ceiling over that formula, which is up to 13 % above what poles say"""
_MEASURE = (
    "identify the servo with its link on, and set model.inertia, model.load_inertia and"
    " model.flexible_hz"
)


def assumed(belief: Belief, decision: Decision, damping_cap: float) -> str:
    """Return in words which gear train and horn are assumed, and what a link would change.

    Args:
        belief: One without a measured vibration.
        decision: Decision in force.
        damping_cap: Share of the ceiling that may be commanded.
    """
    if not belief.transmission_stiffness.high > 0.0:
        return (
            "no vibration is known (model.flexible_hz is not set): a rigid servo without a link is"
            " assumed. A link on the horn may vibrate at a virtual damping far below the ceiling of"
            f" {decision.damping_ceiling:.3g} N·m·s/rad: {_MEASURE}"
        )
    train, load = belief.transmission_stiffness, belief.load_inertia
    said = (
        "no vibration is known (model.flexible_hz is not set): a gear train of"
        f" {train.low:g} to {train.high:g} N·m/rad is assumed"
    )
    if load.high > 0.0:
        said += (
            f", and on it a load of at most {load.high:.2g} kg·m², which vibrates at"
            f" {belief.flexible_hz.low:.2g} Hz or above"
        )
    most = largest_link(belief, decision, damping_cap)
    if most is None or most <= load.high:
        return f"{said}. A heavier one changes this: {_MEASURE}"
    return (
        f"{said}. A link changes this: one of more than {most:.1g} kg·m² may vibrate at the"
        f" commanded damping of {decision.damping:.3g} N·m·s/rad: {_MEASURE}"
    )


def largest_link(belief: Belief, decision: Decision, damping_cap: float) -> float | None:
    """Return the heaviest link with which the guard would surely command the same damping [kg·m²].

    At any delay the ceiling is at least about ``2 zeta omega`` times the whole inertia, and omega²
    is ``k (1 / motor + 1 / link)``.

    Args:
        belief: Belief with a stiffness of the transmission.
        decision: Decision with the damping.
        damping_cap: Share of the ceiling that may be commanded.

    Returns:
        None where any link does, and where the damping is 0 or below.
    """
    if not decision.damping > 0.0 or not belief.flexible_damping_ratio.low > 0.0:
        return None
    motor, gain = belief.inertia.low, belief.torque_gain.high
    needed = decision.damping * gain / (damping_cap * _OF_FORMULA)
    rate = needed / (2.0 * belief.flexible_damping_ratio.low * motor)
    per_link = rate**2 / belief.transmission_stiffness.low - 1.0 / motor
    return 1.0 / per_link if per_link > 0.0 else None
