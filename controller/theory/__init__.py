"""The stability theory of sampled virtual walls; imports no other room."""

from haptic_wall.controller.theory.exact import (
    critical_stiffness,
    max_virtual_damping,
)
from haptic_wall.controller.theory.linear import linear_limit
from haptic_wall.controller.theory.one_sided import one_sided_limit
from haptic_wall.controller.theory.passivity import passive_limit

__all__ = [
    "critical_stiffness",
    "linear_limit",
    "max_virtual_damping",
    "one_sided_limit",
    "passive_limit",
]
