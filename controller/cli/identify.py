"""``haptic-wall identify``: moves a servo, and estimates inertia, friction and delay."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.experiment import (
    REACH,
    Asked,
    experiment,
    moving,
)
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import (
    answer,
    config_argument,
    reading,
    say,
    writing,
    written,
)
from haptic_wall.controller.cli.places import FileToWrite, new_stem
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import whole
from haptic_wall.hw.errors import Problem

_FIT_S = 10.0
"""Usual duration of the fit of a record [s]"""
_OF_A_MOTION = {
    "config": "CONFIG",
    "sets": "--set",
    "axis": "--axis",
    "out": "--out",
    "yes": "--yes",
    "reach": "--reach",
}
"""Parameters that mean nothing with ``--record``"""


@click.command()
@click.option("--plot", type=FileToWrite(picture=True), help="Draw the fit as PNG to this path.")
@click.option(
    "--reach",
    type=Number(),
    default=REACH,
    show_default=True,
    metavar="RAD",
    help="Largest excursion of the shaft to either side of its position.",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Fit the motion recorded in this CSV. Nothing moves, and CONFIG is left out.",
)
@click.option(
    "--pendulum-mass",
    type=Number(0, 100, above=True, unit="kg"),
    metavar="KG",
    help="With --record: mass of the weight that hangs on the shaft.",
)
@click.option(
    "--pendulum-length",
    type=Number(0, 10, above=True, unit="m"),
    metavar="M",
    help="With --record: distance from the axis to that weight's centre.",
)
@experiment(
    click.option(
        "--out",
        type=FileToWrite(),
        metavar="FILE",
        help="Write CONFIG to this path, with the identified values in its model section.",
    ),
    config_argument(needed=False),
)
def command(
    asked: Asked | None,
    plot: Path | None,
    reach: float,
    record: Path | None,
    pendulum_mass: float | None,
    pendulum_length: float | None,
) -> None:
    """Find inertia, friction and delay of CONFIG's servo from its motion.

    The shaft moves by itself to both sides, and must be free to turn.

    With --record FILE nothing moves; the recorded motion is fitted. FILE is a CSV with the columns
    time_s and position_rad and, if known, torque_nm, current_a and torque_enabled (0: the motor is
    off).
    """
    pendulum = {"--pendulum-mass": pendulum_mass, "--pendulum-length": pendulum_length}
    given = [name for name, value in pendulum.items() if value is not None]
    missing = [name for name in pendulum if name not in given]
    if record is not None:
        source = click.get_current_context().get_parameter_source
        words = [name for name in _OF_A_MOTION if source(name) is ParameterSource.COMMANDLINE]
        if named := " and ".join(_OF_A_MOTION[name] for name in words):
            raise UserError(
                f"found with {named}, but a record moves nothing, and no configuration is read or"
                " written",
                field="--record",
                advice=f"leave {named} out",
            )
        if given and missing:
            what = f"missing beside {given[0]}"
            raise UserError(what, field=missing[0], advice="give both, or neither")
        _fit_record(record, plot, pendulum_mass, pendulum_length)
        return
    if given:
        advice = "add --record FILE, or leave the option out"
        raise UserError("found without --record", field=given[0], advice=advice)
    if asked is None:
        raise UserError("missing", field="CONFIG", advice="give a configuration, or --record FILE")
    from haptic_wall.controller.experiments.identify.identification import (
        SECONDS,
        announcement,
        bounds_of,
        identify,
    )
    from haptic_wall.controller.experiments.identify.identified_config import identified_config
    from haptic_wall.controller.experiments.identify.text import report, text
    from haptic_wall.controller.report.identify import plot_identification

    loaded, out = asked.loaded, asked.out
    about = announcement(bounds_of(loaded.config, reach))
    logs = new_stem("--plot", f"identify-{Path(asked.name).stem}")
    plot = plot or logs.with_name(f"{logs.name}.png")
    say(f"{loaded.name}: {about}")
    asked.may_move()
    with moving(loaded.config, SECONDS):
        found = identify(loaded.config, logs, reach, say)
    result: dict[str, Any] = {"name": loaded.name, **report(found)}
    sets = " ".join(f"--set {change}" for change in asked.sets)
    failed: Problem | None = None
    if out is not None:
        try:
            origin = f"{loaded.name} {sets}".rstrip()
            belief = identified_config(loaded.config, found, origin, loaded.axis, loaded.whole)
            with writing("--out", out), whole(out) as part:
                part.write_text(belief, encoding="utf-8")
            result["config"] = str(out)
        except UserError as error:  # told when the figures are printed
            failed, result["config"] = error.problem, None
    result["plot"] = drawn_or_noted("--plot", plot, partial(plot_identification, found, asked.name))
    paths = [each for each in (result.get("config"), result["plot"], logs) if each is not None]
    answer(result, lambda: "\n".join([text(found), "", *written(paths)]))
    if sets and result.get("config"):
        say(f"{out} has {sets} too")
    if failed is not None:
        raise UserError(failed)


def _fit_record(record: Path, plot: Path | None, mass: float | None, length: float | None) -> None:
    """Fit a recorded motion, with a pendulum of mass [kg] and length [m], and print the result."""
    from haptic_wall.controller.experiments.recorded.record import read_record

    with working("fitting the motion", _FIT_S):
        with reading("--record", record, "a CSV"):
            motion = read_record(record)
        from haptic_wall.controller.experiments.recorded import estimate
        from haptic_wall.controller.experiments.recorded.text import report, text

        pendulum = None if mass is None or length is None else estimate.Pendulum(mass, length)
        found = estimate.identify_record(motion, pendulum)
    result = {"name": record.name, **report(found), "plot": None}
    if plot is not None and found.shot is not None:
        from haptic_wall.controller.report.identify import plot_recorded

        draw = partial(plot_recorded, found, record.name)
        result["plot"] = drawn_or_noted("--plot", plot, draw)
    answer(result, lambda: text(found, result["plot"]))
