"""``haptic-wall detect``: runs the oscillation detector over a log or CSV."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.options import (
    FileToWrite,
    answer,
    as_json,
    json_option,
    reading,
    refuse_other_pictures,
    refuse_same_file,
)
from haptic_wall.controller.cli.places import force_option, take_file
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError

if TYPE_CHECKING:
    from haptic_wall.controller.logs.detected import Detected, GivenWall

_NUMBER = click.FLOAT
_LOG_BYTES_S, _CSV_BYTES_S = 2e7, 5e6
"""Bytes of a file processed in a second"""
_LIGHTEST, _MOST = 1e-12, 1e6
"""Range of the servo's given values, in SI units"""


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--inertia", type=_NUMBER, metavar="m", help="Inertia of the servo [kg·m²].")
@click.option(
    "--damping", type=_NUMBER, metavar="b", help="Viscous friction [N·m·s/rad]; reported only."
)
@click.option("--coulomb", type=_NUMBER, metavar="c", help="Coulomb friction [N·m]; reported only.")
@click.option(
    "--delay", type=_NUMBER, metavar="S", help="Delay from a sample until its torque acts [s]."
)
@click.option(
    "--stiffness", type=_NUMBER, metavar="K", help="Stiffness of the rendered wall [N·m/rad]."
)
@click.option(
    "--virtual-damping",
    type=_NUMBER,
    metavar="B",
    help="Virtual damping of the rendered wall [N·m·s/rad].",
)
@click.option(
    "--wall-position", type=_NUMBER, metavar="X", help="Position of the rendered wall [rad]."
)
@click.option("--plot", type=FileToWrite(), help="Draw the result as PNG to this path.")
@force_option
@json_option
def command(
    log: Path,
    inertia: float | None,
    damping: float | None,
    coulomb: float | None,
    delay: float | None,
    stiffness: float | None,
    virtual_damping: float | None,
    wall_position: float | None,
    plot: Path | None,
    force: bool,
    as_json_wanted: bool,
) -> None:
    """Look for an oscillation in LOG: a log that run wrote, or a CSV.

    A CSV needs the columns time_s and position_rad. With torque_nm, the torque commanded at each
    sample, the detector separates an oscillation that the wall feeds from the motion of a hand. A
    log has the parameters of servo and wall in its configuration; the options replace them, or give
    those of a CSV.
    """
    from haptic_wall.controller.logs.detected import NO_WALL, detect_all
    from haptic_wall.controller.logs.file import is_log
    from haptic_wall.controller.logs.recordings import MOST_LAG_S, read_recordings
    from haptic_wall.controller.logs.replayed import replayed

    given = {"inertia": inertia, "damping": damping, "coulomb": coulomb, "lag": delay}
    for name, value in given.items():
        least = 0.0 if name != "inertia" else _LIGHTEST
        most = MOST_LAG_S if name == "lag" else _MOST
        if value is not None and not (least <= value <= most):
            option = "delay" if name == "lag" else name
            wanted = "above 0 and up to" if name == "inertia" else "from 0 to"
            raise UserError(
                f"found {value:g}", field=f"--{option}", wanted=f"a number {wanted} {most:g}"
            )
    wall = _given_wall(stiffness, virtual_damping, wall_position)
    refuse_same_file({"LOG": log, "--plot": plot})
    if plot is not None:
        refuse_other_pictures("--plot", plot)
        take_file("--plot", plot, force=force)
    with reading("LOG", log, "a log of run, or a CSV"):
        of_ours = is_log(log)
        pace = _LOG_BYTES_S if of_ours else _CSV_BYTES_S
        with working("analysing the motion", log.stat().st_size / pace):
            detected = None
            if wall == NO_WALL and of_ours:
                detected = replayed(log, given)
            if detected is None:
                detected = detect_all(read_recordings(log), given, wall)
    if not detected.drawn:
        raise UserError(
            f"found no stretch of sufficient length: {'; '.join(detected.notes)}",
            field="LOG",
            given=log,
        )
    if plot is not None:
        from haptic_wall.controller.report.detect import plot_detection

        parts, found = zip(*detected.drawn, strict=True)
        plot = drawn_or_noted("--plot", plot, partial(plot_detection, parts, found))
    report = _report(detected, plot)
    answer(as_json(report) if as_json_wanted else _text(report))


def _given_wall(
    stiffness: float | None, virtual_damping: float | None, position: float | None
) -> GivenWall:
    from haptic_wall.controller.logs.detected import GivenWall

    if stiffness is not None and not 0.0 < stiffness < math.inf:
        raise UserError(f"found {stiffness:g}", field="--stiffness", wanted="a number above 0")
    for name, value in (("virtual-damping", virtual_damping), ("wall-position", position)):
        if value is not None and not math.isfinite(value):
            raise UserError(f"found {value:g}", field=f"--{name}", wanted="a finite number")
    return GivenWall(stiffness, virtual_damping, position)


def _report(detected: Detected, plot: Path | None) -> dict[str, Any]:
    known = detected.known
    alarm = detected.first_alarm_s
    return {
        "state": detected.state.name.lower(),
        "frequency_hz": detected.frequency_hz,
        "amplitude_rad": detected.amplitude or None,
        "growth_per_s": detected.growth,
        "first_alarm_s": None if math.isnan(alarm) else alarm,
        "samples": detected.samples,
        "parts": detected.parts,
        "period_s": detected.period,
        "known": {
            "inertia": known["inertia"],
            "damping": known["damping"],
            "coulomb": known["coulomb"],
            "delay": known["lag"],
            "position_step": detected.position_step,
            **detected.wall,
        },
        "notes": detected.notes,
        "plot": plot,
    }


def _text(report: dict[str, Any]) -> str:
    def known(name: str, unit: str) -> str:
        value = report[name]
        return f"{value:.4g} {unit}" if value is not None and math.isfinite(value) else "none"

    from haptic_wall.controller.logs.recording import seconds

    alarm = report["first_alarm_s"]
    lines = [
        f"state       {report['state']}",
        f"frequency   {known('frequency_hz', 'Hz')}",
        f"amplitude   {known('amplitude_rad', 'rad')}",
        f"growth      {known('growth_per_s', '1/s')}",
        f"alarm       {'none' if alarm is None else f'first after {seconds(alarm)} s'}",
        f"record      {report['samples']} samples, one each {1e3 * report['period_s']:.4g} ms",
        *(f"note        {note}" for note in report["notes"]),
    ]
    if report["plot"] is not None:
        lines.append(f"picture     {report['plot']}")
    return "\n".join(lines)
