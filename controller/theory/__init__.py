"""The stability theory of sampled virtual walls; imports no other room."""

from haptic_wall.controller.theory.boundary import CriticalPoint
from haptic_wall.controller.theory.exact import (
    critical_point,
    critical_stiffness,
    max_virtual_damping,
    peak,
)
from haptic_wall.controller.theory.linear import linear_limit
from haptic_wall.controller.theory.one_sided import one_sided_limit, restitution
from haptic_wall.controller.theory.passivity import passive_limit

__all__ = [
    "CriticalPoint",
    "critical_point",
    "critical_stiffness",
    "linear_limit",
    "max_virtual_damping",
    "one_sided_limit",
    "passive_limit",
    "peak",
    "restitution",
]
