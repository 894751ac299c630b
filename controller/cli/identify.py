"""``haptic-wall identify``: moves a servo, and estimates inertia, friction and delay."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.experiment import REACH, Asked, endings, experiment, moving
from haptic_wall.controller.cli.identify_record import identify_record, refuse_pendulum
from haptic_wall.controller.cli.options import (
    FileToWrite,
    refuse_other_pictures,
    refuse_same_file,
    say,
    writing,
)
from haptic_wall.controller.cli.places import new_stem, take_file, take_folder
from haptic_wall.controller.errors import SeveralError, UserError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import Loaded
from haptic_wall.controller.system.file_kinds import PICTURE, Kind
from haptic_wall.controller.system.whole_file import whole
from haptic_wall.hw.errors import Problem

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.identify.boundary_fit import BoundaryPoints
    from haptic_wall.controller.experiments.identify.identification import Identified

_CONFIG = Kind(
    "a configuration that haptic-wall identify wrote",
    re.compile(rb"# [^\n]*haptic-wall identify found on"),
)


@click.command()
@click.option("--plot", "plot_path", type=FileToWrite(), help="Draw the fit as PNG to this path.")
@click.option("--logs", type=click.Path(path_type=Path), metavar="DIR",
              help="Folder for the logs of the motions; default: one in ./runs/.")  # fmt: skip
@click.option(
    "--reach",
    type=float,
    default=REACH,
    show_default=True,
    metavar="RAD",
    help="Largest excursion of the shaft to either side of its position.",
)
@click.option(
    "--from-sweep",
    "sweep",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A sweep.json: also fit damping and delay to its boundary, and compare both results.",
)
@click.option(
    "--no-motion",
    is_flag=True,
    help="With --from-sweep: move nothing; compare the boundary with the model section of CONFIG.",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Fit the motion recorded in this CSV. Nothing moves, and CONFIG is left out.",
)
@click.option(
    "--pendulum-mass",
    type=float,
    metavar="KG",
    help="With --record: mass of the weight that hangs on the shaft.",
)
@click.option(
    "--pendulum-length",
    type=float,
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
    without=("record", identify_record),
)
def command(
    asked: Asked,
    plot_path: Path | None,
    logs: Path | None,
    reach: float,
    sweep: Path | None,
    no_motion: bool,
    record: None,  # noqa: ARG001 - with one, identify_record is called
    pendulum_mass: float | None,
    pendulum_length: float | None,
) -> None:
    """Find inertia, friction and delay of CONFIG's servo from its motion.

    The shaft moves by itself to both sides, and must be free to turn.

    With --record FILE nothing moves; the recorded motion is fitted. FILE is a CSV with the columns
    time_s and position_rad and, if known, torque_nm, current_a and torque_enabled (0: the motor is
    off).
    """
    refuse_pendulum(pendulum_mass, pendulum_length)
    from haptic_wall.controller.experiments.identify.identification import announcement, bounds_of
    from haptic_wall.controller.experiments.identify.text import report

    loaded, out = asked.loaded, asked.out
    if no_motion and (sweep is None or out is not None):
        raise UserError(
            "without motion only the boundary of a sweep can be fitted",
            field="--no-motion",
            advice="give --from-sweep FILE too, and leave --out out",
        )
    boundary = None if sweep is None else _boundary(sweep, loaded.config)
    found = None
    failures: list[Problem] = []
    result: dict[str, Any] = {"name": loaded.name}
    if not no_motion:
        about = announcement(bounds_of(loaded.config, reach))
        read = {"CONFIG": asked.file, "--from-sweep": sweep}
        plot_path, logs = _places(out, plot_path, logs, read, loaded.name, force=asked.force)
        say(f"{loaded.name}: {about}")
        asked.may_move()
        found = _moved(loaded, logs, reach)
        result |= report(found)
        kept = _Kept(asked.force)
        if out is not None:
            result["config"] = kept.write("--out", out, _CONFIG, partial(_write, found, loaded))
        draw = partial(_draw, found, loaded.name)
        result["plot"] = drawn_or_noted("--plot", plot_path, draw, force=asked.force)
        failures = kept.failures
    if boundary is not None:
        result["from_sweep"] = _from_sweep(*boundary, loaded, found)
    asked.answer(result, lambda: _text(result, found, logs))
    if failures:
        raise SeveralError(failures)


def _text(result: dict[str, Any], found: Identified | None, logs: Path | None) -> str:
    """Return the results and the paths of the files as text."""
    from haptic_wall.controller.experiments.identify.text import text

    lines = [text(result, found)]
    if found is not None:
        written = result.get("config"), result["plot"], logs
        lines += ["", "written", *(f"  {path}" for path in written if path is not None)]
    return "\n".join(lines)


def _places(
    out: Path | None,
    plot: Path | None,
    logs: Path | None,
    read: Mapping[str, Path | None],
    name: str,
    *,
    force: bool,
) -> tuple[Path, Path]:
    """Return the places of picture and logs; refuse unwritable ones before anything moves."""
    if plot is not None:
        refuse_other_pictures("--plot", plot)
    refuse_same_file({**read, "--out": out, "--plot": plot})
    for option, path, kind in (("--out", out, _CONFIG), ("--plot", plot, PICTURE)):
        if path is not None:
            take_file(option, path, kind, force=force, make=True)
    if logs is not None:
        take_folder("--logs", logs, {}, force=force)
    if plot is not None and logs is not None:
        return plot, logs
    stem = new_stem("--logs" if logs is None else "--plot", f"identify-{Path(name).stem}")
    return plot or stem.with_name(f"{stem.name}.png"), logs or stem


def _moved(loaded: Loaded, logs: Path, reach: float) -> Identified:
    """Move and fit."""
    from haptic_wall.controller.experiments.identify.identification import SECONDS, identify

    ended = endings("nothing is identified", f"the logs are in {logs}")
    with moving(loaded.config, SECONDS), ended:
        return identify(loaded.config, logs, reach, say)


@dataclass(slots=True)
class _Kept:
    """Writes files; collects the errors until the figures are printed."""

    force: bool
    failures: list[Problem] = field(default_factory=list)

    def write(
        self, option: str, path: Path, kind: Kind, write: Callable[[Path], None]
    ) -> str | None:
        """Where the file is; None: it could not be written."""
        try:
            with writing(option, path), whole(path, kind, force=self.force) as part:
                write(part)
        except UserError as error:
            self.failures.append(error.problem)
            return None
        return str(path)


def _draw(found: Identified, name: str, path: Path) -> None:
    from haptic_wall.controller.report.identify import plot_identification

    plot_identification(found, name, path)


def _boundary(sweep: Path, config: Config) -> tuple[BoundaryPoints, Config]:
    """Return the points of a sweep, and their configuration: by default ``config``."""
    from pydantic import ValidationError

    from haptic_wall.controller.experiments.identify.boundary_fit import read_points

    try:
        points, held = read_points(sweep)
        return points, config if held is None else Config.model_validate(held)
    except (ValidationError, RecursionError):
        raise UserError(
            "this program does not know the configuration in it",
            field="--from-sweep",
            given=sweep,
            advice="name the sweep.json that haptic-wall sweep wrote",
        ) from None


def _from_sweep(
    points: BoundaryPoints,
    measured_with: Config,
    loaded: Loaded,
    found: Identified | None,
) -> dict[str, Any]:
    """Return the boundary's results beside those of the motion or the belief."""
    from haptic_wall.controller.experiments.estimated import Estimated
    from haptic_wall.controller.experiments.identify.boundary_fit import KnownLoop, fit_boundary
    from haptic_wall.controller.experiments.identify.text import (
        believed,
        boundary_report,
        comparison,
    )

    belief = loaded.config.belief()
    if found is None:
        believing = belief.torque_gain, belief.inertia, belief.coulomb
        gain, inertia, coulomb = (b.value for b in believing)
        damping, delay = believed(loaded.config)
    else:
        finding = found.torque_gain, found.inertia, found.coulomb
        gain, inertia, coulomb = (e.value for e in finding)
        damping, delay = found.damping, found.delay
    # The boundary was measured in commanded torque.
    known = (Estimated(damping.value / gain, damping.stderr / gain), delay)
    loop = KnownLoop(
        inertia=inertia / gain,
        coulomb=coulomb / gain,
        period=measured_with.period_s,
        velocity_samples=measured_with.wall.velocity_samples,
        lag=measured_with.belief().delay.value,
    )
    try:
        fit = fit_boundary(points, loop)
    except ValueError as error:
        raise UserError(
            f"nothing can be fitted to its points: {error}", field="--from-sweep"
        ) from None
    compared = comparison(known, (fit.damping, fit.delay))
    return {
        **boundary_report(fit),
        "compared_with": "belief" if found is None else "motion",
        "compared": compared,
    }


def _write(found: Identified, loaded: Loaded, path: Path) -> None:
    from haptic_wall.controller.experiments.identify.identified_config import identified_config

    path.write_text(identified_config(loaded.config, found, loaded.name), encoding="utf-8")
