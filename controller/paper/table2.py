"""Table II: critical stiffness by theory and by simulation, beside the printed values."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from haptic_wall.controller.report import style
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import TrueServo

INERTIA = 1.0
"""[kg]"""
DAMPING = 0.1
"""[N·s/m]"""
PERIOD = 1e-3
"""[s]"""
_KICK, _NEAR = 0.01, 1e-4
"""Of the simulation: kick, which does not matter without friction, and relative accuracy"""
PRINTED_STEP = 0.01
"""The table's last digit [N/m]"""
SOURCES = ("theory", "simulation")
"""Origins of our values"""


@dataclass(frozen=True, slots=True)
class Table2:
    """All cells; stiffness [N/m] of shape (delays, virtual dampings)."""

    delay_samples: FloatArray
    """Shape (9,)"""
    virtual_damping: FloatArray
    """Shape (4,) [N·s/m]"""
    printed: FloatArray
    theory: FloatArray
    simulation: FloatArray

    def error_percent(self, source: str) -> FloatArray:
        """Return by how much ``theory`` or ``simulation`` exceeds the printed value, in percent."""
        values: FloatArray = getattr(self, source)
        result: FloatArray = 100.0 * (values / self.printed - 1.0)
        return result

    def worst(self, source: str) -> dict[str, float]:
        """Return the cell with the largest error of ``theory`` or ``simulation``.

        Returns:
            ``error_percent`` (positive where ours is above the printed value), ``delay_samples``
            and ``virtual_damping`` [N·s/m].
        """
        error = self.error_percent(source)
        row, column = np.unravel_index(np.argmax(np.abs(error)), error.shape)
        return {
            "error_percent": float(error[row, column]),
            "delay_samples": float(self.delay_samples[row]),
            "virtual_damping": float(self.virtual_damping[column]),
        }


def compare() -> Table2:
    """Compute all 36 cells."""
    delay_samples, virtual_damping, printed = _printed()
    delay, virtual = np.meshgrid(delay_samples * PERIOD, virtual_damping, indexing="ij")
    theory = critical_stiffness(INERTIA, DAMPING, virtual, PERIOD, delay)
    simulation = _simulate(virtual, delay)
    return Table2(delay_samples, virtual_damping, printed, np.asarray(theory), simulation)


def _simulate(virtual_damping: FloatArray, delay: FloatArray) -> FloatArray:
    from haptic_wall.controller.experiments.maps.walls import critical, wall_of

    servo = TrueServo(INERTIA, DAMPING, counts_per_rev=0, torque_limit=math.inf)
    guess = critical_stiffness(INERTIA, DAMPING, virtual_damping, PERIOD, delay)
    found = [
        critical(wall_of(servo, period=PERIOD, delay=late, virtual_damping=b), _KICK, k, _NEAR)
        for b, late, k in zip(
            *(a.ravel().tolist() for a in (virtual_damping, delay, guess)), strict=True
        )
    ]
    return np.array(found).reshape(guess.shape)


def _printed() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the paper's delays in samples, virtual dampings, and stiffness of each cell."""
    with (
        files("haptic_wall.controller.paper").joinpath("table2.csv").open(encoding="utf-8") as file
    ):
        head, *rows = list(csv.reader(file))
    numbers = np.array(rows, dtype=np.float64)
    virtual_damping = np.array([float(name.removeprefix("B_")) for name in head[1:]])
    return numbers[:, 0], virtual_damping, numbers[:, 1:]


COLUMNS = (
    "delay_samples",
    "virtual_damping_ns_per_m",
    "printed_n_per_m",
    "theory_n_per_m",
    "theory_error_percent",
    "simulation_n_per_m",
    "simulation_error_percent",
)


def rows(table: Table2) -> list[tuple[float, ...]]:
    """Return one row per cell, in the order of COLUMNS."""
    delay, virtual = np.meshgrid(table.delay_samples, table.virtual_damping, indexing="ij")
    columns = (
        delay,
        virtual,
        table.printed,
        table.theory,
        table.error_percent("theory"),
        table.simulation,
        table.error_percent("simulation"),
    )
    return list(zip(*(column.ravel().tolist() for column in columns), strict=True))


def write_csv(table: Table2, path: Path) -> None:
    """Write one row per cell, with full precision.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows(rows(table))


def text(table: Table2) -> str:
    """Format the table for a terminal, worst cells last."""
    lines = [
        "Table II: critical stiffness [N/m] for m = 1 kg, b = 0.1 N·s/m, T = 1 ms",
        "",
        "  t_d/T      B   printed    theory  error [%]  simulation  error [%]",
    ]
    for index, (delay, virtual, printed, theory, error_t, simulation, error_s) in enumerate(
        rows(table)
    ):
        if index % len(table.virtual_damping) == 0 and index:
            lines.append("")
        lines.append(
            f"  {delay:5.2f}  {virtual:5.1f}  {printed:8.2f}  {theory:8.2f}  {error_t:+9.4f}"
            f"  {simulation:10.2f}  {error_s:+9.4f}"
        )
    return "\n".join([*lines, "", *worst_text(table)])


def worst_text(table: Table2) -> list[str]:
    """Return a line for theory and one for simulation: the worst cell."""
    return [
        "worst by {}: {error_percent:+.4f} % at t_d/T = {delay_samples:g},"
        " B = {virtual_damping:g} N·s/m".format(source, **table.worst(source))
        for source in SOURCES
    ]


def draw(table: Table2, path: Path) -> None:
    """Draw the errors of all cells over the delay, beside half of the last printed digit."""
    with style.picture(path, style.COLUMN, 2.9) as figure:
        ax = figure.subplots()
        place = np.arange(len(table.delay_samples))
        rounding = 50.0 * PRINTED_STEP / table.printed.min(axis=1)
        ax.axhline(0.0, color=style.GREY, linewidth=0.6)
        colors = style.shades(len(table.virtual_damping))
        for column, (virtual, color) in enumerate(zip(table.virtual_damping, colors, strict=True)):
            beside = place + 0.16 * (column - 1.5)
            theory, simulation = (table.error_percent(source)[:, column] for source in SOURCES)
            ax.plot(
                beside,
                theory,
                "o",
                color=color,
                markersize=2.6,
                label=f"$B$ = {virtual:g} N$\\cdot$s/m",
            )
            ax.plot(beside, simulation, "s", color=color, markersize=5, fillstyle="none", mew=0.7)
        ax.bar(
            place,
            2.0 * rounding,
            0.8,
            -rounding,
            color="#d9d9d9",
            zorder=0.5,
            label="half a printed digit",
        )
        ax.plot([], [], "o", color=style.GREY, markersize=2.6, label="theory")
        ax.plot([], [], "s", color=style.GREY, fillstyle="none", mew=0.7, label="simulation")
        ax.legend(loc="upper right", ncols=2, columnspacing=1.0, handletextpad=0.4)
        lowest = min(-rounding.max(), *(table.error_percent(s).min() for s in SOURCES))
        ax.set_ylim(bottom=1.15 * lowest)
        ax.set_xticks(place, [f"{delay:g}" for delay in table.delay_samples])
        ax.set_xlabel(r"delay  $d = t_d/T$  [samples]")
        ax.set_ylabel("deviation from the printed value [%]")
        ax.tick_params(axis="x", top=False)
        style.grid(ax)
