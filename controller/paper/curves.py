"""Named curves of a figure, for its picture and its CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from haptic_wall.controller.theory import critical_stiffness, linear_limit, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray


@dataclass(frozen=True, slots=True)
class Curve:
    """Points that belong together, in the order in which they are joined."""

    kind: str
    """``exact``, ``linear``, ``peak`` and so on"""
    settings: Mapping[str, float]
    """Settings common to all of its points, by the CSV's column"""
    x: FloatArray
    """Shape (n,)"""
    y: FloatArray
    """Shape (n,)"""


@dataclass(frozen=True, slots=True)
class FigureData:
    """All curves of a figure."""

    x_name: str
    """Column of the horizontal axis"""
    y_name: str
    """Column of the vertical axis"""
    curves: tuple[Curve, ...]

    def of_kind(self, kind: str, **settings: float) -> list[Curve]:
        """Return the curves of a kind, in order; only those with these settings."""
        return [
            curve
            for curve in self.curves
            if curve.kind == kind and settings.items() <= curve.settings.items()
        ]


_POINTS = 401


def dimensionless(curves: Iterable[Curve]) -> FigureData:
    """Return figure data in the plane of beta = B T / m and alpha = K T² / m."""
    return FigureData("beta", "alpha", tuple(curves))


def exact_boundary(delta: float, delay: float) -> Curve:
    """Return the full exact boundary, from beta = -delta to the end at alpha = 0.

    Points are denser towards both ends.

    Args:
        delta: Dimensionless viscous damping b T / m.
        delay: Total delay in periods.
    """
    ceiling = float(max_virtual_damping(1.0, delta, 1.0, delay))
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _POINTS))
    return exact_at(delta, delay, -delta + (ceiling + delta) * share)


def exact_at(delta: float, delay: float, beta: FloatArray) -> Curve:
    """Return the exact boundary at these virtual dampings."""
    alpha = np.asarray(critical_stiffness(1.0, delta, beta, 1.0, delay))
    return Curve("exact", {"delta": delta, "delay_periods": delay}, beta, alpha)


def linear_at(delta: float, delay: float, beta: FloatArray) -> Curve:
    """Return the straight line alpha = 2 (delta + beta) / (1 + 2 d).

    Source: Gil et al., ICRA 2007, eq. (16).
    """
    alpha = np.asarray(linear_limit(delta, beta, 1.0, delay))
    return Curve("linear", {"delta": delta, "delay_periods": delay}, beta, alpha)


def write_csv(data: FigureData, path: Path) -> None:
    """Write one row per point: the curve's kind and settings, then the point, with full precision.

    Raises:
        OSError: The file cannot be written.
    """
    columns = list(dict.fromkeys(key for curve in data.curves for key in curve.settings))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["kind", *columns, data.x_name, data.y_name])
        for curve in data.curves:
            constant = [curve.kind, *(curve.settings.get(key, "") for key in columns)]
            points = zip(curve.x.tolist(), curve.y.tolist(), strict=True)
            writer.writerows([*constant, x, y] for x, y in points)
