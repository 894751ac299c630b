"""The stability theory of sampled virtual walls. Needs numpy only, knows nothing of servos."""

from controller.theory.exact import (
    CriticalPoint,
    critical_point,
    critical_stiffness,
    max_virtual_damping,
    peak,
)
from controller.theory.linear import linear_limit
from controller.theory.passivity import passive_limit

__all__ = [
    "CriticalPoint",
    "critical_point",
    "critical_stiffness",
    "linear_limit",
    "max_virtual_damping",
    "passive_limit",
    "peak",
]
