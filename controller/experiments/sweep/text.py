"""Formats the points of a sweep."""

from __future__ import annotations

from haptic_wall.controller.experiments.sweep.result import PointResult


def cell(value: float | None, digits: int = 4) -> str:
    """Format a number for a table; a dash: it is not known."""
    return "-" if value is None else f"{value:.{digits}g}"


def point_text(point: PointResult) -> str:
    """Return a point in one line."""
    where = f"B {point.virtual_damping:g}, {point.delay_steps} steps"
    if point.measured is None:
        return f"{where}: {point.reason}"
    return (
        f"{where}: {point.measured:.4g} ± {point.uncertainty:.2g} N·m/rad"
        f" (exact {point.exact:.4g}) at {point.frequency_hz or float('nan'):.3g} Hz"
    )


def sweep_text(points: list[PointResult]) -> list[str]:
    """Return a table of the points, with what kept some from being measured."""
    lines = [
        f"{'B':>9} {'delay':>8} {'measured':>10} {'±':>8} {'exact':>9} {'linear':>9}"
        f" {'friction':>9} {'f':>7} {'kick':>8}",
        f"{'N·m·s/rad':>9} {'ms':>8} {'N·m/rad':>10} {'':>8} {'':>9} {'':>9} {'':>9} {'Hz':>7}"
        f" {'rad':>8}",
    ]
    for point in points:
        lines.append(
            f"{point.virtual_damping:>9.4g} {1e3 * point.delay_s:>8.3f} {cell(point.measured):>10}"
            f" {cell(point.uncertainty, 2):>8} {cell(point.exact):>9} {cell(point.linear):>9}"
            f" {cell(point.predicted_with_friction):>9} {cell(point.frequency_hz, 3):>7}"
            f" {cell(point.kick_rad, 3):>8}"
        )
        if point.reason is not None:
            lines.append(f"{'':>9} {point.reason}")
        elif point.trips:
            lines.append(f"{'':>9} trips in between: {'; '.join(point.trips)}")
    return lines
