"""Lists the paper's equations, and the function that implements each.

The paper: J. J. Gil, E. Sanchez, T. Hulin, C. Preusche, G. Hirzinger, "Stability Boundary for
Haptic Rendering: Influence of Damping and Delay", IEEE ICRA 2007.

=============== =================================================================================
(1)             ``no_delay_limit``, ``no_delay_condition``: exact boundary without delay
(4)             ``linear_no_delay``
(5), (14)       ``linear_one_sample``
(6)             ``passive_no_delay``; for any delay ``passive_limit``
(7)-(10), (16)  ``linear``; in SI units ``linear_limit``
(11)            ``characteristic_polynomial``, any whole delay
(12)            ``one_sample_polynomial``; circulates misprinted
(13)            ``one_sample_determinant``, ``one_sample_limit``; circulates misprinted
(15)            ``gain_margin``, least of all crossings
Table I         ``to_dimensionless``, ``to_si``
Fig. 10         ``linear_error``, ``error_points``, ``start_error``
=============== =================================================================================

The exact boundary of its figures, for any delay, is ``critical_stiffness``.
"""

from haptic_wall.controller.theory.closed_forms import (
    characteristic_polynomial,
    gain_margin,
    no_delay_condition,
    no_delay_limit,
    one_sample_determinant,
    one_sample_limit,
    one_sample_polynomial,
)
from haptic_wall.controller.theory.dimensionless import (
    Dimensionless,
    Units,
    to_dimensionless,
    to_si,
)
from haptic_wall.controller.theory.linear import (
    linear,
    linear_limit,
    linear_no_delay,
    linear_one_sample,
    passive_no_delay,
)
from haptic_wall.controller.theory.linear_error import (
    ErrorPoint,
    error_points,
    linear_error,
    start_error,
)

__all__ = [
    "Dimensionless",
    "ErrorPoint",
    "Units",
    "characteristic_polynomial",
    "error_points",
    "gain_margin",
    "linear",
    "linear_error",
    "linear_limit",
    "linear_no_delay",
    "linear_one_sample",
    "no_delay_condition",
    "no_delay_limit",
    "one_sample_determinant",
    "one_sample_limit",
    "one_sample_polynomial",
    "passive_no_delay",
    "start_error",
    "to_dimensionless",
    "to_si",
]
