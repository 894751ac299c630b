"""``haptic-wall detect``: prints a run's verdict, or judges a recorded motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import (
    answer,
    json_option,
    reading,
)
from haptic_wall.controller.cli.places import plot_option
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError

_BYTES_S = 1e6
"""Bytes of a file processed in a second"""
_POSITIVE, _ANY = Number(0.0, 1e6, above=True), Number()
_FROM_0 = Number(0.0, 1e6)
OWN = "the run's own result; any option makes detect judge the recorded motion"


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--inertia", type=_POSITIVE, metavar="m", help="Inertia of the servo [kg·m²].")
@click.option(
    "--damping", type=_FROM_0, metavar="b", help="Viscous friction [N·m·s/rad]; reported only."
)
@click.option("--coulomb", type=_FROM_0, metavar="c", help="Coulomb friction [N·m]; reported only.")
@click.option(
    "--delay",
    "lag",
    type=Number(0.0, 10.0),
    metavar="S",
    help="Delay from a sample until its torque acts [s].",
)
@click.option(
    "--stiffness", type=_POSITIVE, metavar="K", help="Stiffness of the rendered wall [N·m/rad]."
)
@click.option(
    "--virtual-damping",
    type=_ANY,
    metavar="B",
    help="Virtual damping of the rendered wall [N·m·s/rad].",
)
@click.option(
    "--wall-position",
    "surface",
    type=_ANY,
    metavar="X",
    help="Position of the rendered wall [rad]; reported only.",
)
@click.option("--axis", metavar="NAME", help="The axis, in a log of several.")
@plot_option("Draw the result as PNG to this path.")
@json_option
def command(log: Path, plot: Path | None, axis: str | None, **values: float | None) -> None:
    """Look for an oscillation in LOG: a log that run wrote, or a CSV.

    Of a log this is what the run itself saw, with the growth of the recorded motion. With an
    option, and of a CSV, the recorded motion is judged; a log has the parameters of the servo in
    its configuration, and the options replace them. A CSV needs the columns time_s and
    position_rad. With torque_nm, the torque commanded at each sample, the detector separates an
    oscillation that the wall feeds from the motion of a hand.
    """
    from haptic_wall.controller.logs.detected import text, verdict_of
    from haptic_wall.controller.logs.file import is_log
    from haptic_wall.controller.logs.reader import LogReader

    given = {name: value for name, value in values.items() if value is not None}
    with reading("LOG", log, "a log of run, or a CSV"):
        verdict = None
        if is_log(log) and not given and plot is None:
            verdict = verdict_of(LogReader.open(log).axis(axis))
        with working("analysing the motion", log.stat().st_size / _BYTES_S):
            report = _judged(log, axis, given, plot, needed=verdict is None)
    if verdict is not None:
        report |= verdict
        if verdict["state"] == "quiet":
            report["growth_per_s"] = None
        report["notes"] = [OWN]
    answer(report, lambda: text(report))


def _judged(
    log: Path,
    axis: str | None,
    given: Mapping[str, float],
    plot: Path | None,
    *,
    needed: bool,
) -> dict[str, Any]:
    """Judge the recorded motion; return the report.

    Raises:
        UserError: There is no stretch that can be judged, and a judgement is ``needed``.
    """
    from haptic_wall.controller.detector.detection import DetectionRecord
    from haptic_wall.controller.logs.detected import detect_all, read_recording

    recording = read_recording(log, axis)
    if not recording.parts and not needed:
        names = ("growth_per_s", "samples", "parts", "period_s", "known", "plot")
        return dict.fromkeys(names)
    if not recording.parts:
        raise UserError(
            f"found no stretch of sufficient length: {'; '.join(recording.notes)}",
            field="LOG",
            given=log,
        )
    wall = {name: given[name] for name in ("stiffness", "virtual_damping") if name in given}
    records, used = detect_all(recording, {name: given.get(name) for name in _OF_SERVO}, **wall)
    if plot is not None:
        from haptic_wall.controller.report.detect import plot_detection

        draw = partial(plot_detection, recording.parts, records)
        plot = drawn_or_noted("--plot", plot, draw)
    whole = DetectionRecord.joined(records)
    at, alarm = whole.worst_at, whole.first_alarm_s
    known = {**used, **{name: given.get(name) for name in _OF_WALL}}
    return {
        "state": whole.worst.name.lower(),
        "frequency_hz": float(whole.frequency_hz[at]),
        "amplitude_rad": float(whole.amplitude[at]) or None,
        "growth_per_s": float(whole.growth[at]),
        "first_alarm_s": None if math.isnan(alarm) else alarm,
        "samples": recording.samples,
        "parts": len(recording.parts),
        "period_s": recording.period,
        "known": {
            "delay": known.pop("lag"),
            "wall_position": known.pop("surface"),
            "position_step": recording.position_step,
            **known,
        },
        "notes": list(recording.notes),
        "plot": plot,
    }


_OF_SERVO = ("inertia", "damping", "coulomb", "lag")
_OF_WALL = ("stiffness", "virtual_damping", "surface")
