"""``haptic-wall zwidth``: computes and measures the stiffness and damping a servo can render."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import (
    Asked,
    carry_out,
    experiment,
    folder_option,
    say_swing,
)
from haptic_wall.controller.cli.numbers import Number, Numbers
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import make_folder

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.zwidth.impedance import Impedance
    from haptic_wall.controller.experiments.zwidth.measured import Found
    from haptic_wall.controller.experiments.zwidth.plane import Width

_MOST_SAMPLES = 30


@click.command()
@click.option(
    "--velocity-samples",
    "samples",
    type=Numbers(Number(1, _MOST_SAMPLES, whole=True)),
    metavar="N[,N...]",
    help="Lengths of the velocity difference to compare, in samples; default: CONFIG's, 1, 2, 4.",
)
@click.option(
    "--measure",
    type=click.Choice(["own", "all", "none"]),
    help="own: measure the boundary with CONFIG's velocity; all: with all that are compared; none:"
    " do not measure. Default: all on the simulated clock, otherwise own.",
)
@click.option(
    "--log",
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="Log of a run in which a hand moved the shaft in the wall; the impedance is computed from"
    " it. Default: a run with a simulated hand; a real servo needs the log.",
)
@click.option("--fresh", is_flag=True, help="Measure the points of an earlier call again.")
@experiment(
    folder_option(
        "Folder for zwidth.json, zwidth.png and the measured points; default: a new one in ./runs/."
        " The command continues an interrupted call of the same settings in DIR."
    ),
    of_walls=True,
    filters=True,
)
def command(
    asked: Asked,
    samples: list[int] | None,
    measure: str | None,
    log: Path | None,
    fresh: bool,
) -> None:
    """Show the Z-width of CONFIG's servo: the largest stiffness over the virtual damping.

    It compares velocities over several samples and with a filter: by exact theory, by the guard,
    and by measurements as in sweep. It also shows the impedance of CONFIG's wall over frequency,
    commanded and measured. A real shaft moves by itself, unless --measure none is given.
    """
    from haptic_wall.controller.experiments.zwidth.measured import (
        Found,
        impedance_of,
        measure_points,
        seconds_of,
    )
    from haptic_wall.controller.experiments.zwidth.plane import velocities, width_of
    from haptic_wall.controller.report.zwidth import plot_zwidth

    config = asked.config
    if log is not None and not log.is_file():
        raise UserError("there is no such file", field="--log", given=log, wanted="a run's log")
    simulated = config.loop.clock == "simulated"
    which = measure or ("all" if simulated else "own")
    widths = tuple(width_of(config, velocity) for velocity in velocities(config, samples))
    chosen = {"own": widths[:1], "all": widths, "none": ()}[which]
    seconds = seconds_of(chosen)
    if chosen:
        _announce(asked, chosen, seconds)
    else:
        asked = replace(asked, yes=True)  # nothing moves

    def found(folder: Path) -> Found:
        make_folder(folder)
        measure_points(chosen, folder / "measured", fresh, say)
        runs = folder if which != "none" else None
        return Found(config, widths, impedance_of(config, log, runs, say))

    carry_out(asked, "zwidth", seconds, found, Found.report, plot_zwidth, _text)


def _announce(asked: Asked, chosen: Sequence[Width], seconds: float) -> None:
    """Announce the motions."""
    from haptic_wall.controller.experiments.commission.sweep_points import OPTIONS
    from haptic_wall.controller.experiments.sweep.sweep import excursion

    config = asked.config
    if config.loop.clock == "simulated":
        return
    say(f"about {seconds / 60.0:.0f} min in real time")
    if config.servo.kind == "hardware":
        far = max(
            (
                excursion(width.config, width.settings(), OPTIONS)
                for width in chosen
                if width.config is not None
            ),
            default=0.0,
        )
        say_swing(config.servo, far)


def _text(found: Found) -> list[str]:
    lines = [
        "largest stiffness K [N·m/rad], and the virtual damping B [N·m·s/rad] there",
        f"{'velocity':<26}{'ceiling B':>10}{'exact K':>10}{'at B':>9}{'guard K':>10}{'at B':>9}",
    ]
    for width in found.widths:
        lines += _width_lines(width)
    lines += ["", *_impedance_lines(found.impedance)]
    return lines


def _width_lines(width: Width) -> list[str]:
    if width.config is None:
        return [f"{width.velocity.label:<26}{width.reason}"]
    exact, own = width.peak(width.exact), width.peak(width.guard)
    guard = own or width.peak(width.guard_two_sided)
    cells = f"{width.ceiling:>10.4g}"
    for peak in (exact, guard):
        cells += (
            f"{'-':>10}{'-':>9}"
            if peak is None
            else f"{peak['stiffness']:>10.4g}{peak['virtual_damping']:>9.3g}"
        )
    lines = [f"{width.velocity.label:<26}{cells}" + ("" if own else "  two-sided")]
    for point in width.points:
        at = f"  measured at B {point.virtual_damping:<10.3g}"
        if point.measured is None:
            lines.append(f"{at}{point.reason}")
            continue
        lines.append(
            f"{at}{point.measured:.4g} ± {point.uncertainty:.2g}, exact {point.exact:.4g}, with"
            f" friction {_cell(point.predicted_with_friction)}, kick {_cell(point.kick_rad)} rad"
        )
    return lines


def _impedance_lines(found: Impedance) -> list[str]:
    lines = [
        f"impedance of {found.stiffness:.4g} N·m/rad with {found.virtual_damping:.3g} N·m·s/rad,"
        f" delay {1e3 * found.delay_s:.3g} ms"
        + (f"; measured from the torque {found.torque}" if found.rows else ""),
        f"{'f [Hz]':>8}{'law K':>9}{'law B':>10}{'acting K':>10}{'acting B':>10}{'K':>9}{'B':>10}"
        f"{'±':>8}{'coherence':>11}",
    ]
    for band in found.bands:
        lines.append(
            f"{band.frequency_hz:>8.3g}{band.commanded_stiffness:>9.4g}"
            f"{band.commanded_damping:>10.3g}{band.acting_stiffness:>10.4g}"
            f"{band.acting_damping:>10.3g}"
            + (
                f"  {band.reason or ''}"
                if band.stiffness is None
                else f"{band.stiffness:>9.4g}{band.damping:>10.3g}{band.stderr:>8.2g}"
                f"{band.coherence:>11.3f}"
            )
        )
    return [*lines, *filter(None, [found.reason])]


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
