"""``haptic-wall sweep --over damping``: measures the ceiling of the virtual damping."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_wall.controller.cli.experiment import Asked, carry_out
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.errors import UserError

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.sweep.ceiling import CeilingResult

_SECONDS = 40.0
"""Duration of the measurement at one delay, in real time [s]"""


def measure_ceiling(asked: Asked, steps: Sequence[int], dampings: Sequence[float] | None) -> None:
    """Measure the ceiling at each inserted delay, and print the result.

    Args:
        asked: The options of the command.
        steps: Inserted periods.
        dampings: Must be None: the search chooses them.

    Raises:
        UserError: Dampings were given, or files cannot be written.
        EndedEarlyError: A person or a trip ended it.
    """
    from haptic_wall.controller.experiments.sweep.ceiling import ceiling_sweep
    from haptic_wall.controller.experiments.sweep.sweep import experiment_config
    from haptic_wall.controller.report.ceiling import plot_ceiling

    if dampings:
        raise UserError(
            "found values",
            field="--virtual-damping",
            wanted="none with --over damping: the search chooses them",
        )
    config = experiment_config(asked.config)
    say(f"{asked.name}: the shaft travels by itself, 0.35 rad to each side, at up to 1.5 rad/s")
    carry_out(
        asked,
        "ceiling",
        _SECONDS * len(steps),
        lambda folder: ceiling_sweep(config, folder / "logs", steps, say),
        lambda found: {"ceilings": [each.report() for each in found]},
        plot_ceiling,
        _text,
    )


def _text(found: Sequence[CeilingResult], paths: Sequence[Path]) -> str:
    lines = [
        f"{'delay':>8} {'ceiling':>10} {'±':>8} {'believed':>9} {'rigid':>9} {'f':>7}",
        f"{'ms':>8} {'N·m·s/rad':>10} {'':>8} {'':>9} {'':>9} {'Hz':>7}",
    ]
    for each in found:
        cells = (each.measured, each.uncertainty, each.exact, each.rigid, each.frequency_hz)
        ceiling, error, exact, rigid, hertz = (
            "-" if value is None else f"{value:.3g}" for value in cells
        )
        lines.append(
            f"{1e3 * each.delay_s:>8.3f} {ceiling:>10} {error:>8} {exact:>9} {rigid:>9} {hertz:>7}"
        )
        if each.reason is not None:
            lines.append(f"{'':>8} {each.reason}")
    return "\n".join([*lines, "", "written", *(f"  {path}" for path in paths)])
