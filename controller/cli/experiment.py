"""Shared frame of the experiments' commands: options, consent to move, files, answer, endings.

A command is a function of ``Asked`` and of its own options, under ``experiment``. One that writes a
report and a picture to a folder hands the rest to ``carry_out``.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.options import (
    answer,
    as_json,
    axis_option,
    config_argument,
    json_option,
    say,
    set_option,
    writing,
)
from haptic_wall.controller.cli.places import force_option, new_stem, take_folder
from haptic_wall.controller.cli.working import Work, working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import Loaded, file_of, load_axis
from haptic_wall.controller.settings.servo import Servo
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.open import find_port

Found = TypeVar("Found")
_FASTER = 20.0
"""The simulated clock than real time"""
REACH = 0.6
"""Default excursion of an identification, to each side [rad]"""
_YES = click.option("--yes", is_flag=True, help="Do not ask before a real servo moves.")


@dataclass(frozen=True, slots=True)
class Asked:
    """The options that all experiments share."""

    loaded: Loaded
    file: Path | None
    """The configuration's file; None for a preset"""
    out: Path | None
    """Argument of ``--out``"""
    yes: bool
    """Consent to move is already given"""

    @property
    def config(self) -> Config:
        """Return the effective configuration."""
        return self.loaded.config

    @property
    def name(self) -> str:
        """Return the configuration's name, for messages."""
        return self.loaded.name

    def find_port(self) -> None:
        """Refuse a port that does not exist, before any work is done.

        Raises:
            PortError: There is none.
        """
        servo = self.config.servo
        if servo.kind == "hardware" and (self.yes or sys.stdin.isatty()):  # else it is refused
            find_port(servo.port or "")

    def may_move(self) -> None:
        """Wait for a person's consent before a real servo moves by itself.

        Raises:
            click.Abort: Consent is refused.
        """
        servo = self.config.servo
        if servo.kind != "hardware" or self.yes or not sys.stdin.isatty():
            return
        say(
            "keep the shaft's way free and the power switch within reach; Ctrl-C ends the motion at"
            " any time and switches the torque off"
        )
        click.confirm(f"May servo {servo.id} at {servo.port} move?", abort=True, err=True)


def experiment(
    out: Callable[[Any], Any],
    default: str | None = None,
    *,
    moves: bool = True,
    of_walls: bool = False,
    filters: bool = False,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command CONFIG and the options of all experiments, as ``Asked``.

    Args:
        out: The option ``--out``, as ``folder_option`` makes it.
        default: CONFIG where none is given; None: it must be given.
        moves: The command has ``--yes``.
        of_walls: It measures a wall, and refuses any other law.
        filters: It counts ``wall.velocity_filter``; others refuse it.
    """

    def decorated(function: Callable[..., None]) -> Callable[..., None]:
        @wraps(function)
        def command(
            config: str,
            sets: tuple[str, ...],
            out: Path | None,
            axis: str | None,
            yes: bool = False,
            **own: Any,  # noqa: ANN401 - the command's own options
        ) -> None:
            asked = asked_of(config, sets, out, yes, axis, of_walls=of_walls, filters=filters)
            if moves:
                asked.find_port()
            function(asked, **own)

        return experiment_options(out, config_argument(default), moves=moves)(command)

    return decorated


def experiment_options(
    out: Callable[[Any], Any], config: Callable[[Any], Any], *, moves: bool = True
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of all experiments, for ``asked_of``; see ``experiment``."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        last = (out, axis_option, set_option, config)
        for option in (json_option, force_option, *[_YES] * moves, *last):
            command = option(command)
        return command

    return decorated


def asked_of(
    config: str,
    sets: tuple[str, ...],
    out: Path | None,
    yes: bool,
    axis: str | None,
    *,
    of_walls: bool = False,
    filters: bool = False,
) -> Asked:
    """Load CONFIG; see ``experiment``.

    Raises:
        UserError: It is wrong, or has what the experiment does not know.
    """
    loaded = load_axis(config, sets, axis, runs=not of_walls)
    wall = loaded.config.wall
    section = f"axes.{loaded.axis}.wall" if loaded.axis else "wall"
    for name, found, wanted, why in (
        ("law", wall.law if of_walls else "wall", "wall", "only walls are measured"),
        (
            "velocity_filter",
            "none" if filters else wall.velocity_filter,
            "none",
            "only the experiment zwidth knows a filter",
        ),
    ):
        if found != wanted:
            raise UserError(
                f"found {found}",
                field=f"wall.{name}",
                wanted=f"{wanted}: {why}",
                advice=f"give --set {section}.{name}={wanted}; haptic-wall run renders {found}",
            )
    return Asked(loaded, file_of(config), out, yes)


def folder_option(text: str, *, needed: bool = False) -> Callable[[Any], Any]:
    """``--out DIR``."""
    kind = click.Path(path_type=Path)
    return click.option("--out", type=kind, metavar="DIR", help=text, required=needed)


def carry_out(
    asked: Asked,
    what: str,
    seconds: float,
    measure: Callable[[Path], Found],
    report: Callable[[Found], Mapping[str, Any]],
    draw: Callable[[Found, str, Path], None] | None,
    text: Callable[[Found], list[str]],
    *,
    rows: Callable[[Found], Iterable[Mapping[str, Any]]] | None = None,
    others: Iterable[str] = (),
    work: AbstractContextManager[object] | None = None,
    ended: Callable[[Found], tuple[str, int] | None] = lambda _found: None,
) -> None:
    """Measure, write the report and the picture, and answer.

    Args:
        asked: The options.
        what: The command; JSON, picture and table are called so.
        seconds: How long it takes in real time, about [s].
        measure: Measures; its argument is the folder for logs.
        report: Returns JSON-ready values.
        draw: Draws the picture, of what was found, with a title, to a path; None: there is none.
        text: Returns the lines of the answer for people; those of the files written follow.
        rows: Returns the rows of a CSV table; None: there is none.
        others: Files that keep what an earlier call has found, which this one continues.
        work: Shows that it works; None: that a servo is moved.
        ended: Returns what is kept of a measurement that ended early, up to the words "--out DIR
            continues", and the exit status; None: it is complete.

    Raises:
        UserError: The files cannot be written.
        EndedEarlyError: A person or a trip ended the experiment.
    """
    folder = asked.out
    files = (f"{what}.json", f"{what}.png")
    if folder is None:
        folder = new_stem("--out", what)
    else:
        tables = () if rows is None else (f"{what}.csv",)
        with writing("--out", folder):
            begun = any((folder / name).exists() for name in others)  # it is continued
        take_folder("--out", folder, () if begun else (*files, *tables))
    asked.may_move()
    with work or moving(asked.config, seconds), endings():
        found = measure(folder)
    result, picture = (folder / name for name in files)
    held = {**RESULT_MARK, "name": asked.name, **report(found)}
    table = [] if rows is None else [folder / f"{what}.csv"]
    with writing("--out", folder), ExitStack() as all_or_none:
        folder.mkdir(parents=True, exist_ok=True)  # it may have gone meanwhile
        if rows is not None:
            _write_table(all_or_none.enter_context(whole(table[0])), rows(found))
        picture_of = draw and partial(draw, found, asked.name)
        seen = picture_of and drawn_or_noted("--out", picture, picture_of)
        paths = [result, *table, *([seen] if seen else [])]
        part = all_or_none.enter_context(whole(result))
        part.write_text(as_json({**held, "files": paths}) + "\n", encoding="utf-8")
    where = ["", "written", *(f"  {path}" for path in paths)]
    answer({**held, "files": paths}, lambda: "\n".join([*text(found), *where]))
    if (early := ended(found)) is not None:
        say(f"{early[0]} --out {folder} continues")
        sys.exit(early[1])


def _write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows of equal keys as CSV; lists as one cell."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer: csv.DictWriter[str] | None = None
        for row in rows:
            if writer is None:
                writer = csv.DictWriter(stream, list(row))
                writer.writeheader()
            writer.writerow(
                {k: "; ".join(map(str, v)) if isinstance(v, list) else v for k, v in row.items()}
            )


def say_swing(servo: Servo, far: float) -> None:
    """Announce how far a sweep moves a real servo to both sides [rad]."""
    say(
        f"the shaft of servo {servo.id} at {servo.port} will swing to both sides of its position,"
        f" by at most about {far:.2g} rad ({far * 57.3:.0f} degrees), with up to"
        f" {servo.torque_limit:g} N·m, at rising stiffness; Ctrl-C ends the motion"
    )


def moving(config: Config, seconds: float) -> AbstractContextManager[Work]:
    """Show that a servo is being moved.

    Args:
        config: Configuration of the servo.
        seconds: Approximate duration in real time [s].
    """
    simulated = config.loop.clock == "simulated"
    return working("measuring", seconds / _FASTER if simulated else seconds)


@contextmanager
def endings(interrupted: str = "", tripped: str = "") -> Iterator[None]:
    """Raise with the right exit status if a person or a trip ends the experiment in this block.

    Args:
        interrupted: Text to add if a person ended it.
        tripped: Text to add if a trip ended it.
    """
    from haptic_wall.controller.experiments.testbed import (
        ExperimentInterruptedError,
        ExperimentTrippedError,
    )
    from haptic_wall.controller.processes.run_report import exit_status

    try:
        yield
    except ExperimentInterruptedError as error:
        raise EndedEarlyError(_with(error.problem, interrupted), INTERRUPTED) from None
    except ExperimentTrippedError as error:
        status = exit_status(error.stop_reason)
        problem = replace(error.problem, what=f"{error.stop_reason}: {error.problem.what}")
        raise EndedEarlyError(_with(problem, tripped), status) from None


def _with(problem: Problem, more: str) -> Problem:
    """Return the problem with more to say, if any, in place of its advice."""
    return replace(problem, what=str(problem), wanted="", advice=more) if more else problem
