"""``haptic-wall rendered``: compares rendered stiffness, drag and contacts with commanded ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import Asked, carry_out, experiment, folder_option
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import say

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.rendered.rendering import Rendering


@click.command()
@click.option("--seed", type=Number(0, whole=True), default=0, help="Seed of all random choices.")
@experiment(
    folder_option(
        "Folder for rendered.json, rendered.png and the logs; default: a new one in ./runs/."
    ),
    of_walls=True,
)
def command(asked: Asked, seed: int) -> None:
    """Measure the stiffness, friction and contacts that CONFIG's servo renders.

    The shaft moves as for ``identify``, a slow torque pushes it in the wall to both sides, and it
    hits the wall. The shaft moves by up to half a radian to each side.
    """
    from haptic_wall.controller.experiments.rendered.rendering import (
        SECONDS,
        measure_rendering,
        rendering_report,
    )
    from haptic_wall.controller.report.rendered import plot_rendering

    carry_out(
        asked,
        "rendered",
        SECONDS,
        measure=lambda folder: measure_rendering(asked.config, folder, seed, say),
        report=rendering_report,
        draw=plot_rendering,
        text=_text,
    )


def _text(found: Rendering) -> list[str]:
    """Return the comparison as a table."""
    lines = [
        f"{'':<32}{'commanded':>12}{'rendered':>12}{'± stderr':>12}{'ratio':>8}",
    ]
    for row in found.rows:
        unit = "" if row.unit == "1" else f" [{row.unit}]"
        cells = _cell(row.commanded) + _cell(row.rendered) + _cell(row.stderr, 2)
        lines.append(
            f"{row.name + unit:<32}{cells}"
            + (f"{row.ratio:>8.3f}" if row.ratio is not None else f"{'':>8}")
            + (f"  {row.note}" if row.note else "")
        )
    if found.binding is not None:
        lines.append(
            f"{found.requested.stiffness:g} N·m/rad were requested; the guard commands"
            f" {found.stiffness:.4g} ({found.binding} limit)"
        )
    return [*lines, *found.notes]


def _cell(value: float | None, digits: int = 4) -> str:
    return f"{'-':>12}" if value is None else f"{value:>12.{digits}g}"
