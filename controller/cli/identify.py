"""``haptic-wall identify``: moves a servo, and estimates inertia, friction and delay."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.experiment import (
    REACH,
    asked_of,
    endings,
    experiment_options,
    moving,
)
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import (
    answer,
    config_argument,
    reading,
    say,
    writing,
)
from haptic_wall.controller.cli.places import FileToWrite, new_stem
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import SeveralError, UserError
from haptic_wall.controller.settings.load import Loaded
from haptic_wall.controller.system.files import whole
from haptic_wall.hw.errors import Problem

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.identify.identification import Identified

_FIT_S = 10.0
"""Usual duration of the fit of a record [s]"""


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
@experiment_options(
    click.option(
        "--out",
        type=FileToWrite(),
        metavar="FILE",
        help="Write CONFIG to this path, with the identified values in its model section.",
    ),
    config_argument(needed=False),
)
def command(
    config: str | None,
    sets: tuple[str, ...],
    out: Path | None,
    axis: str | None,
    yes: bool,
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
        needless = {
            "CONFIG": config,
            "--set": sets,
            "--axis": axis,
            "--out": out,
            "--yes": yes,
        }
        needless["--reach"] = reach != REACH
        if named := " and ".join(name for name, has in needless.items() if has):
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
    if config is None:
        raise UserError("missing", field="CONFIG", advice="give a configuration, or --record FILE")
    asked = asked_of(config, sets, out, yes, axis)
    asked.find_port()
    from haptic_wall.controller.experiments.identify.identification import announcement, bounds_of
    from haptic_wall.controller.experiments.identify.text import report

    loaded = asked.loaded
    about = announcement(bounds_of(loaded.config, reach))
    logs = new_stem("--plot", f"identify-{Path(asked.name).stem}")
    plot = plot or logs.with_name(f"{logs.name}.png")
    say(f"{loaded.name}: {about}")
    asked.may_move()
    found = _moved(loaded, logs, reach)
    result: dict[str, Any] = {"name": loaded.name, **report(found)}
    failed: Problem | None = None
    if out is not None:
        try:
            with writing("--out", out), whole(out) as part:
                _write(found, loaded, sets, part)
            result["config"] = str(out)
        except UserError as error:  # told when the figures are printed
            failed, result["config"] = error.problem, None
    draw = partial(_draw, found, loaded.name)
    result["plot"] = drawn_or_noted("--plot", plot, draw)
    answer(result, lambda: _text(result, found, logs))
    if sets and result.get("config"):
        say(f"{out} has {_given(sets)} too")
    if failed is not None:
        raise SeveralError([failed])


def _text(result: dict[str, Any], found: Identified, logs: Path) -> str:
    """Return the results and the paths of the files as text."""
    from haptic_wall.controller.experiments.identify.text import text

    written = result.get("config"), result["plot"], logs
    paths = [f"  {path}" for path in written if path is not None]
    return "\n".join([text(found), "", "written", *paths])


def _moved(loaded: Loaded, logs: Path, reach: float) -> Identified:
    """Move and fit."""
    from haptic_wall.controller.experiments.identify.identification import SECONDS, identify

    ended = endings("nothing is identified", f"the logs are in {logs}")
    with moving(loaded.config, SECONDS), ended:
        return identify(loaded.config, logs, reach, say)


def _draw(found: Identified, name: str, path: Path) -> None:
    from haptic_wall.controller.report.identify import plot_identification

    plot_identification(found, name, path)


def _given(sets: Sequence[str]) -> str:
    return " ".join(f"--set {change}" for change in sets)


def _write(found: Identified, loaded: Loaded, sets: Sequence[str], path: Path) -> None:
    from haptic_wall.controller.experiments.identify.identified_config import identified_config

    source = f"{loaded.name} {_given(sets)}".rstrip()
    text = identified_config(loaded.config, found, source, loaded.axis, loaded.whole)
    path.write_text(text, encoding="utf-8")


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
