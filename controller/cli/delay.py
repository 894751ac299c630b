"""``haptic-wall delay``: measures the loop's delay, from a sample to its torque's motion."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import (
    ask_to_move,
    endings,
    folder_for,
    keep,
    moving,
    yes_option,
)
from haptic_wall.controller.cli.numbers import periods
from haptic_wall.controller.cli.options import (
    answer,
    as_json,
    config_argument,
    json_option,
    say,
    set_option,
)
from haptic_wall.controller.cli.places import force_option
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.delay_parts import ms
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.system.file_kinds import RESULT_MARK

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.delay import LoopDelay


@click.command()
@config_argument()
@set_option
@click.option(
    "--delay-steps",
    "steps",
    callback=periods,
    metavar="n[,n...]",
    help="Whole periods to insert and to recover, beside those of CONFIG; default: 0 and 5 more.",
)
@click.option(
    "--bursts",
    type=click.IntRange(1, 1000),
    metavar="N",
    help="Bursts of torque steps in each run; four times as many halve the error (8).",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the steps' lengths.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Where delay.json, delay.png and the logs go; default: a folder in ./runs/.",
)
@yes_option
@force_option
@json_option
def command(
    config: str,
    sets: tuple[str, ...],
    steps: list[float] | None,
    bursts: int | None,
    seed: int,
    out: Path | None,
    yes: bool,
    force: bool,
    as_json_wanted: bool,
) -> None:
    """Measure the delay of CONFIG's loop from torque command to motion, and what it is made of.

    The torque is stepped to and fro; the shaft swings by a few degrees about where it is. The same
    is done with delay inserted on purpose, which must be found again.
    """
    from haptic_wall.controller.experiments.delay import (
        BURST_S,
        BURSTS,
        CHECK_STEPS,
        delay_report,
        measure_delay,
    )

    loaded = load_config(config, sets)
    effective = loaded.config
    chosen = _whole([0.0, effective.delay.steps + CHECK_STEPS] if steps is None else steps)
    folder = folder_for(out, "delay", force=force)
    ask_to_move(effective.servo, yes)
    count = bursts or BURSTS
    with moving(effective, BURST_S * count * len(chosen)), endings():
        found = measure_delay(effective, folder, chosen, count, seed, say)
    from haptic_wall.controller.report.delay import plot_delay

    files = [folder / "delay.json", folder / "delay.png"]
    report = {
        **RESULT_MARK,
        "name": loaded.name,
        **delay_report(found, effective.period_s, effective.belief().delay.high),
        "files": files,
    }
    keep(folder, "delay", report, partial(plot_delay, found, loaded.name), force=force)
    answer(as_json(report) if as_json_wanted else _text(found, effective.period_s, files))


def _whole(values: list[float]) -> list[int]:
    for value in values:
        if value != int(value) or not 0 <= value <= 200:
            raise UserError(f"--delay-steps: found {value:g}, wanted whole periods from 0 to 200")
    return [int(value) for value in values]


def _text(found: LoopDelay, period: float, files: list[Path]) -> str:
    """Format a table of the parts, one of the recovered delays, and the files."""
    lines = [
        f"delay from sample to motion  {_with_error(found.total.value, found.total.stderr)}",
        f"  inserted                   {ms(found.configured * period)}",
        f"  age of the sample          {ms(found.age_median)} (median; the guard counts"
        f" {ms(found.age_high)})",
        f"  device, sending to motion  {_with_error(found.device.value, found.device.stderr)}",
        "",
        f"{'inserted':>10}  {'measured':>20}  {'recovered':>20}",
    ]
    for point in found.points:
        recovered = point.recovered
        lines.append(
            f"{ms(point.inserted):>10}  {_with_error(point.total.value, point.total.stderr):>20}  "
            + (
                f"{_with_error(recovered.value, recovered.stderr):>20}"
                if recovered
                else f"{'(reference)':>20}"
            )
        )
    return "\n".join([*lines, *found.notes, "", "written", *(f"  {path}" for path in files)])


def _with_error(value: float, stderr: float) -> str:
    return f"{1e3 * value:.3f} ± {1e3 * stderr:.3f} ms"
