"""Formats the numbers beside a picture, from the same data as its CSV."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_wall.controller.paper.curves import FigureData
from haptic_wall.controller.paper.table2 import Table2, rows

HEADINGS = {
    "kind": "point",
    "delta": "δ = bT/m",
    "delay_periods": "d = t_d/T",
    "delay_s": "t_d [s]",
    "damping_nms_per_rad": "b [N·m·s/rad]",
    "inertia_kgm2": "m [kg·m²]",
    "error_percent": "error [%]",
    "beta": "β = BT/m",
    "alpha": "α = KT²/m",
    "virtual_damping_nms_per_rad": "B [N·m·s/rad]",
    "stiffness_nm_per_rad": "K [N·m/rad]",
}
"""Heading of each CSV column on the page"""


@dataclass(frozen=True, slots=True)
class Numbers:
    """A small table: headings and rows of the same length."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def of_points(data: FigureData) -> Numbers | None:
    """Return the single points of a figure (peaks and so on), five digits; None: it has none."""
    points = [curve for curve in data.curves if curve.x.size == 1]
    if not points:
        return None
    settings = list(dict.fromkeys(key for point in points for key in point.settings))
    return Numbers(
        head=tuple(HEADINGS[key] for key in ("kind", *settings, data.x_name, data.y_name)),
        rows=tuple(
            (
                point.kind,
                *(f"{point.settings[key]:g}" for key in settings),
                f"{point.x[0]:.5g}",
                f"{point.y[0]:.5g}",
            )
            for point in points
        ),
    )


def of_table2(table: Table2) -> Numbers:
    """Return all cells; stiffness with the printed digits, errors with four."""
    return Numbers(
        head=(
            "d = t_d/T",
            "B [N·s/m]",
            "printed [N/m]",
            "theory [N/m]",
            "error [%]",
            "simulation [N/m]",
            "error [%]",
        ),
        rows=tuple(
            (
                f"{delay:g}",
                f"{virtual:g}",
                f"{printed:.2f}",
                f"{theory:.2f}",
                f"{theory_error:+.4f}",
                f"{simulation:.2f}",
                f"{simulation_error:+.4f}",
            )
            for delay, virtual, printed, theory, theory_error, simulation, simulation_error in rows(
                table
            )
        ),
    )
