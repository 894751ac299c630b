"""Fits delay and damping to a measured stability boundary: critical stiffness over virtual damping.

The straight part of the boundary is ``K = (b + B)/(T/2 + t_d)``: its slope gives the delay, its
intercept the damping. The exact boundary of a given inertia is fitted to all points. Coulomb
friction is replaced by its equivalent damping at the amplitude of each point.

Source: J. J. Gil et al., ICRA 2007, eqs. (8) and (16); friction by its describing function,
4 c/(pi A w).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.system import json_text
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import FloatArray

_STRAIGHT = 0.01
"""A point belongs to the straight part where the exact boundary differs from the line by less than
this fraction"""
_LEAST = 3e-3
"""Lower bound of the relative uncertainty of a critical stiffness"""
_HUGE = 1e9
"""Largest plausible quantity of a servo, in SI units"""
_UNKNOWN = 0.02
"""Relative uncertainty where the sweep gives none"""


@dataclass(frozen=True, slots=True)
class BoundaryPoints:
    """Measured points of the boundary, arrays of one shape (n,)."""

    virtual_damping: FloatArray
    """[N·m·s/rad]"""
    delay: FloatArray
    """Total delay as believed in the measurement [s]"""
    stiffness: FloatArray
    """Measured critical stiffness [N·m/rad]"""
    uncertainty: FloatArray
    """Its standard error [N·m/rad]"""
    frequency: FloatArray
    """Frequency of the oscillation [Hz]; NaN: not known"""
    kick: FloatArray
    """Amplitude at which the oscillation neither grows nor decays [rad]; NaN: not known"""


@dataclass(frozen=True, slots=True)
class KnownLoop:
    """The known parameters of the loop."""

    inertia: float
    """[kg·m²]"""
    coulomb: float
    """[N·m]"""
    period: float
    """[s]"""
    velocity_samples: int
    lag: float
    """The device's own delay that is included in the points' delay [s]"""


@dataclass(frozen=True, slots=True)
class BoundaryFit:
    """Damping and delay of the servo, estimated from the boundary."""

    damping: Estimated
    """[N·m·s/rad]"""
    delay: Estimated
    """Lag of the device [s]"""
    line_damping: Estimated | None
    """From the straight part alone; None: it has too few points"""
    line_delay: Estimated | None
    used: int
    """Number of points with a measured stiffness"""
    straight: int
    """Number of them on the straight part"""


def read_points(path: Path) -> tuple[BoundaryPoints, dict[str, Any] | None]:
    """Read the points of a ``sweep.json``, and the configuration of the measurement.

    Args:
        path: With ``points [{virtual_damping, delay_s, measured, uncertainty, frequency_hz,
            kick_rad}]``; points without a measured stiffness are left out.

    Raises:
        UserError: The file cannot be read, or holds no such points.
    """
    try:
        held = json_text.held_in(path)
        listed = [point for point in held["points"] if point.get("measured")]
        columns = [
            _column(listed, name, needed)
            for name, needed in (
                ("virtual_damping", True),
                ("delay_s", True),
                ("measured", True),
                ("uncertainty", False),
                ("frequency_hz", False),
                ("kick_rad", False),
            )
        ]
        config = held.get("config")
    except OSError as error:
        raise UserError(
            f"cannot be read: {error.strerror}",
            field="--from-sweep",
            given=path,
            advice="name the sweep.json of a sweep",
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError) as error:
        raise UserError(
            f"found no points of a sweep in it ({type(error).__name__}: {error})",
            field="--from-sweep",
            given=path,
            advice="name the sweep.json that haptic-wall sweep wrote",
        ) from error
    points = BoundaryPoints(*columns)
    known = np.concatenate([points.virtual_damping, points.delay, points.stiffness])
    others = np.concatenate([points.uncertainty, points.frequency, points.kick])
    possible = np.abs(known) < _HUGE, (others < _HUGE) | np.isnan(others), points.delay >= 0.0
    if not all(map(np.all, (*possible, points.stiffness > 1.0 / _HUGE))):
        raise UserError(
            "found impossible values",
            field="--from-sweep",
            given=path,
            wanted=f"finite values below {_HUGE:g}, with delay and stiffness from 0 up",
            advice="name the sweep.json that haptic-wall sweep wrote",
        )
    if points.stiffness.size < 3 or np.unique(points.virtual_damping).size < 2:
        raise UserError(
            f"found {points.stiffness.size} measured points at "
            f"{np.unique(points.virtual_damping).size} virtual dampings",
            field="--from-sweep",
            given=path,
            wanted="at least 3 points at 2: the slope gives the delay",
        )
    return points, config if isinstance(config, dict) else None


def _column(listed: list[dict[str, Any]], name: str, needed: bool) -> FloatArray:
    values = [point[name] if needed else point.get(name) for point in listed]
    return np.array([math.nan if value is None else float(value) for value in values], float)


def fit_boundary(points: BoundaryPoints, loop: KnownLoop) -> BoundaryFit:
    """Fit damping and delay of the exact boundary to the points.

    Args:
        points: At least three points, at two virtual dampings or more.
        loop: Inertia and friction are taken as known.
    """
    stiffness = points.stiffness
    said = np.where(np.isfinite(points.uncertainty), points.uncertainty, _UNKNOWN * stiffness)
    sigma = np.maximum(said, _LEAST * stiffness)
    helped = _friction(points, loop.coulomb)
    everywhere = np.ones(stiffness.shape, bool)
    damping, late = _line(points, sigma, helped, loop.period, everywhere)[0]

    def left(values: FloatArray) -> FloatArray:
        return (_exact(points, loop, helped, *values.tolist()) - stiffness) / sigma

    begin = np.array([max(damping, 1e-3 * loop.inertia), max(late, -0.5 * points.delay.min())])
    low = [0.0, -float(points.delay.min())]
    scale = np.array([max(begin[0], loop.inertia), loop.period])
    found = least_squares(
        left, np.maximum(begin, np.array(low) + 1e-9), bounds=(low, [np.inf, 1.0]), x_scale=scale
    )
    damping, late = found.x.tolist()
    errors = _errors(found.jac, found.fun)
    exact = _exact(points, loop, helped, damping, late)
    total = damping + helped + points.virtual_damping
    line = total / (0.5 * loop.period + points.delay + late)
    straight = np.abs(exact - line) <= _STRAIGHT * line
    different = np.unique(points.virtual_damping[straight])
    enough = np.count_nonzero(straight) >= 3 and different.size >= 2
    line_damping = line_delay = None
    if enough:
        (value, extra), own = _line(points, sigma, helped, loop.period, straight)
        line_damping = Estimated(value, own[0])
        line_delay = Estimated(loop.lag + extra, own[1])
    return BoundaryFit(
        damping=Estimated(damping, errors[0]),
        delay=Estimated(loop.lag + late, errors[1]),
        line_damping=line_damping,
        line_delay=line_delay,
        used=int(stiffness.size),
        straight=int(np.count_nonzero(straight)),
    )


def _friction(points: BoundaryPoints, coulomb: float) -> FloatArray:
    """Return the equivalent damping of friction at each point's amplitude [N·m·s/rad]."""
    speed = math.tau * points.frequency * points.kick
    known = np.isfinite(speed) & (speed > 0.0)
    return np.where(known, 4.0 * coulomb / (math.pi * np.where(known, speed, 1.0)), 0.0)


def _exact(
    points: BoundaryPoints, loop: KnownLoop, helped: FloatArray, damping: float, late: float
) -> FloatArray:
    return critical_stiffness(
        loop.inertia,
        np.maximum(damping + helped, 0.0),
        points.virtual_damping,
        loop.period,
        np.maximum(points.delay + late, 0.0),
        loop.velocity_samples,
    )


def _line(
    points: BoundaryPoints,
    sigma: FloatArray,
    helped: FloatArray,
    period: float,
    which: NDArray[np.bool_],
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Fit damping and additional delay of the straight line; return also their standard errors.

    ``K (T/2 + t_d + late) = b + B`` is linear in both: ``b - K late = K (T/2 + t_d) - B``.
    """
    stiffness = points.stiffness[which]
    delay = 0.5 * period + points.delay[which]
    columns = np.column_stack([np.ones(stiffness.size), -stiffness])
    right = stiffness * delay - points.virtual_damping[which] - helped[which]
    weight = 1.0 / (sigma[which] * delay)
    found = np.linalg.lstsq(columns * weight[:, None], right * weight, rcond=None)[0]
    left = (columns @ found - right) * weight
    errors = _errors(columns * weight[:, None], left)
    return (float(found[0]), float(found[1])), errors


def _errors(jacobian: FloatArray, left: FloatArray) -> tuple[float, float]:
    """Return standard errors, enlarged if the points scatter more than their uncertainties."""
    spread = float(left @ left) / max(1, left.size - 2)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * max(1.0, spread)
    damping, delay = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    return float(damping), float(delay)
