"""Names the behaviour of a servo that the model, an inertia with friction, does not have."""

from __future__ import annotations

import math
from collections.abc import Iterator

from haptic_wall.controller.experiments.identify.fitting import Fit
from haptic_wall.controller.experiments.identify.loads import Loads

STRUCTURED = 1.5
"""Least reported residual, as a multiple of the rounding's"""
_ERRORS, _SHARE = 4.0, 0.02
"""Least reported load: in standard errors, and as a fraction of the Coulomb friction"""
_STUCK = 1.15
"""Least reported ratio of friction at rest to friction in motion"""
END = "the bounds allow for it, the model does not know it"


def misfit(fit: Fit, rounding: float) -> Iterator[str]:
    """Yield sentences, without their full stop.

    Args:
        fit: Of the servo.
        rounding: Root mean square of the rounding's residual [rad].
    """
    if fit.loads is not None:
        yield from (f"{text}; {END}" for text in _loads(fit.loads, fit.coulomb))
    if fit.residual > STRUCTURED * rounding:
        yield (
            f"the residual is {1e3 * fit.residual:.2g} mrad where rounding leaves"
            f" {1e3 * rounding:.2g}: something moves the shaft that is not known (a loose horn, a"
            " hand, a friction that changes, or grows with the torque); the bounds are wider for"
            " it, and may still miss the truth"
        )


def _loads(loads: Loads, coulomb: float) -> Iterator[str]:
    errors = [*loads.errors, *[0.0] * 6]
    excess = loads.static - coulomb
    if loads.static > _STUCK * coulomb and excess > _ERRORS * errors[0]:
        yield (f"it sticks: friction is {loads.static:.2g} N·m at rest and {coulomb:.2g} in motion")
    if loads.cogging > max(_ERRORS * math.hypot(*errors[4:6]), _SHARE * coulomb):
        yield (
            f"it cogs: {loads.cogging:.2g} N·m to and fro, about {loads.periods:.0f} periods per"
            " turn"
        )
    if loads.gravity > max(_ERRORS * math.hypot(*errors[2:4]), _SHARE * coulomb):
        angle = loads.hanging
        yield (
            f"a torque goes with the angle, {loads.gravity:.2g} N·m at most: a weight that hangs at"
            f" {angle:.2f} rad ({math.degrees(angle):.0f}°), a spring, or cogging of a few periods"
            " per turn"
        )
