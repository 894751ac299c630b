"""Names the behaviour of a servo that the model, an inertia with friction, does not have."""

from __future__ import annotations

import math
from collections.abc import Iterator

from haptic_wall.controller.experiments.identify.fit import Fit

STRUCTURED, _PLAIN = 1.5, 1.2
"""Residual without noise, over the rounding's, above which it is reported, and narrows no belief;
and the same where no effect was fitted, because a fit with effects may have failed"""
_SHARE = 0.02
"""Least reported torque, as a fraction of the Coulomb friction; and least fraction of the load"""
_UNEVEN = 0.05
"""Least reported difference of the damping between the directions, over the damping"""
_STUCK = 1.15
"""Least reported ratio of friction at rest to friction in motion"""
END = "the bounds cover this effect, the model lacks it"


def is_structured(residual: float, noise: float, rounding: float, plain: bool) -> bool:
    """Whether a residual has more than the readings' noise: what the model lacks [all in rad].

    Args:
        residual: Root mean square of the residual.
        noise: The same of noise and rounding of the readings.
        rounding: The same of rounding alone.
        plain: No effect was fitted.
    """
    most = _PLAIN if plain else STRUCTURED
    return residual**2 - noise**2 > (most**2 - 1.0) * rounding**2


def misfit(fit: Fit, noise: float, rounding: float) -> Iterator[str]:
    """Yield sentences, without their full stop.

    Args:
        fit: Fit of the servo.
        noise: Root mean square of noise and rounding of the readings [rad].
        rounding: The same of rounding alone [rad].
    """
    yield from (f"{text}; {END}" for text in _frictions(fit))
    yield from (f"{text}; {END}" for text in _torques(fit))
    if is_structured(fit.residual, noise, rounding, not fit.effects):
        yield (
            f"the residual is {1e3 * fit.residual:.2g} mrad, of which noise and rounding explain"
            f" {1e3 * noise:.2g} mrad: an unknown effect moves the shaft (a loose horn, a hand,"
            " a changing friction); so the bounds are those believed before"
        )


def _frictions(fit: Fit) -> Iterator[str]:
    coulomb = fit["coulomb"]
    slow = coulomb + max(fit["excess"], 0.0)
    if fit["static"] > _STUCK * slow:
        yield f"the shaft sticks: friction is {fit['static']:.2g} N·m at rest, {slow:.2g} moving"
    if fit["excess"]:
        yield (
            f"friction fades with the speed: {fit['excess']:.2g} N·m of it over"
            f" {fit['fading']:.2g} rad/s, which is hard to separate from viscous friction"
        )
    elif fit["drag"]:
        yield (
            "torque is lost with the square of the speed, as by a drive that does not cancel its"
            f" back-EMF: {fit['drag']:.2g} N·m at 1 rad/s"
        )
    if abs(fit["gear"]) > _SHARE:
        yield f"the gear adds {100.0 * fit['gear']:.2g} % of its load to the friction"
    if abs(fit["uneven"]) > 0.5 * _UNEVEN * fit["damping"]:
        ways = [fit["damping"] + sign * fit["uneven"] for sign in (1.0, -1.0)]
        yield (
            f"viscous friction is {ways[0]:.2g} N·m·s/rad forwards and {ways[1]:.2g} backwards; the"
            " smaller value is used"
        )
    if fit["dead_band"] > _SHARE * coulomb:
        yield f"the motor makes {fit['dead_band']:.2g} N·m less than commanded"


def _torques(fit: Fit) -> Iterator[str]:
    coulomb = fit["coulomb"]
    if fit.cogging > _SHARE * coulomb:
        yield (
            f"cogging: an amplitude of {fit.cogging:.2g} N·m, about {fit['periods']:.0f}"
            " periods per turn"
        )
    if fit.gravity > _SHARE * coulomb:
        angle = fit.hanging
        yield (
            f"a torque of at most {fit.gravity:.2g} N·m depends on the angle: a weight that"
            f" hangs at {angle:.2f} rad ({math.degrees(angle):.0f}°), a spring, or cogging with few"
            " periods per turn"
        )
